"""Goals made up for a bench: curves of four kinds, from ones that any rope keeps to ones that few rods do."""

from collections.abc import Callable, Iterator

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.errors import ShapeError
from dlokit.types.arrays import Float64Array

_TIGHTEST_M, _WIDEST_M = 0.03, 0.25  # radius of the tightest bend of a goal
_CLEARANCE_M = 0.045
_EXTENT_M = (0.44, 0.66)  # of the table that arm and camera share
_SAMPLES = 401
_ATTEMPTS = 2000

Curvature = Callable[[np.random.Generator, Float64Array], Float64Array]
"""Draws the curvature (K,) [1/m] at lengths (K,) [m] along a rod."""


def made_goals(seed: int, length_m: float, radius_m: float) -> Iterator[tuple[str, Float64Array]]:
    """One goal (101, 3) [m] of each kind, in the middle of the table, drawn from a seed."""
    for index, (kind, curvature) in enumerate(_KINDS.items()):
        yield f"{kind}-{seed}", _made(curvature, np.random.default_rng([seed, index]), length_m, radius_m)


def placed(curve_m: Float64Array, length_m: float, radius_m: float) -> Float64Array:
    """A curve (K, 3) [m] scaled to a rod, the middle of its extent moved to the middle of the table: (101, 3) [m]."""
    nodes = shapes.fit_length(curve_m, length_m)
    middle = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
    result = geometry.resample(shapes.moved(nodes, np.array(shapes.CENTRE_M) - middle), shapes.CURVE_POINTS)
    result[:, 2] = radius_m
    return result


def _made(curvature: Curvature, rng: np.random.Generator, length_m: float, radius_m: float) -> Float64Array:
    s = np.linspace(0.0, length_m, _SAMPLES)
    for _ in range(_ATTEMPTS):
        goal = shapes.from_curvature(curvature(rng, s), length_m, shapes.CURVE_POINTS, radius_m=radius_m)
        fits = bool(np.all(np.ptp(goal[:, :2], axis=0) < _EXTENT_M))
        if fits and shapes.self_clearance_m(goal) >= _CLEARANCE_M:
            return goal
    raise ShapeError(f"No made-up goal of {length_m:.2f} m fits the table; bench a shorter DLO.")


def _peak(rng: np.random.Generator) -> float:
    return 1.0 / float(np.exp(rng.uniform(np.log(_TIGHTEST_M), np.log(_WIDEST_M))))


def _arcs(rng: np.random.Generator, s: Float64Array) -> Float64Array:
    """One to three arcs of one radius and angle to either side in turn; two of them are an S."""
    peak, count, angle = _peak(rng), int(rng.integers(1, 4)), np.radians(rng.uniform(40.0, 180.0))
    gap_m = s[-1] / count
    arc_m = min(angle / peak, gap_m - 2.0 * shapes.RAMP_M)
    curvature = np.zeros_like(s)
    for arc in range(count):
        off_m = np.abs(s - (arc + 0.5) * gap_m)
        curvature += (-1.0) ** arc * peak * np.clip((arc_m / 2.0 + shapes.RAMP_M - off_m) / shapes.RAMP_M, 0.0, 1.0)
    return curvature


def _spiral(rng: np.random.Generator, s: Float64Array) -> Float64Array:
    """Curvature that changes evenly from one end to the other."""
    share = s / s[-1]
    first, last = _peak(rng), rng.choice([-1.0, 1.0]) * 0.5 * _peak(rng)
    ends = np.clip(np.minimum(share, 1.0 - share) * s[-1] / shapes.RAMP_M, 0.0, 1.0)
    return np.asarray((first * (1.0 - share) + last * share) * ends, dtype=np.float64)


def _wave(rng: np.random.Generator, s: Float64Array) -> Float64Array:
    """Two to six even wiggles."""
    return _peak(rng) * np.sin(np.pi * s / s[-1] * int(rng.integers(2, 7)))


def _random(rng: np.random.Generator, s: Float64Array) -> Float64Array:
    """A series of five sines."""
    order = np.arange(1, 6)
    curvature = np.sin(np.pi * (s / s[-1])[:, None] * order) @ (rng.normal(size=5) / np.sqrt(order))
    return np.asarray(curvature / np.abs(curvature).max() * _peak(rng), dtype=np.float64)


_KINDS: dict[str, Curvature] = {"arcs": _arcs, "spiral": _spiral, "wave": _wave, "random": _random}
