"""How far a rod that lies across or upon itself is from one that does not."""

import numpy as np

from dlokit import geometry
from dlokit.types.arrays import Float64Array

Crossing = tuple[int, int]
"""Two edges that cross, by their first nodes, the lower first."""


def parting_rmse_m(nodes_world: Float64Array, crossings: list[Crossing], radius_m: float) -> float:
    """About the least RMSE [m] by which a rod (M, 3) [m] must move to lie clear of itself.

    Two strands that cross once part when the tail beyond is drawn back over the other strand, or that over the tail's
    end; two that cross twice when what lies between is pushed back. Either may move half of the way. The crossing that
    costs most counts; strands that only touch part by their radii.
    """
    count = len(nodes_world)
    points = nodes_world[:, :2]
    squares = [min(_tail(points, pair), *(_between(points, pair, other) for other in crossings)) for pair in crossings]
    return float(np.sqrt(max(squares, default=_touching(points, radius_m)) / 2.0 / count))


def _tail(points: Float64Array, crossing: Crossing) -> float:
    """Sum of squares [m²] of the shorter tail's way back over the strand that it crosses."""
    first, second = crossing
    middle = (first + second) // 2 + 1
    return min(_sum(points[: first + 1], points[middle:]), _sum(points[second + 1 :], points[:middle]))


def _between(points: Float64Array, one: Crossing, other: Crossing) -> float:
    """The same of what lies between two crossings of the same two strands; infinite where there are not two."""
    (a, c), (b, d) = sorted((one, other))
    if one == other or b >= min(c, d):
        return np.inf
    low, high = min(c, d), max(c, d)
    return min(_sum(points[a + 1 : b + 1], points[low : high + 2]), _sum(points[low + 1 : high + 1], points[a : b + 2]))


def _sum(moved: Float64Array, strand: Float64Array) -> float:
    """Sum of squares [m²] of the distances of points (K, 2) [m] from the nearest of a strand (L, 2) [m]."""
    if not len(moved) or not len(strand):
        return 0.0
    distances = np.linalg.norm(moved[:, None] - strand[None], axis=2).min(axis=1)
    return float((distances**2).sum())


def _touching(points: Float64Array, radius_m: float) -> float:
    s = geometry.arc_lengths(points)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    apart[np.abs(s[:, None] - s[None]) < 2.0 * np.pi * radius_m] = np.inf
    return float((np.clip(2.0 * radius_m - apart.min(axis=1), 0.0, None) ** 2).sum())
