"""Which point belongs where on the rod: softly and coarsely first, then to segments within a window."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.mixture import squared_distances

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """Every point's place on the chain."""

    segment: Indices
    """(N,) j, between nodes j and j + 1."""
    t: Array
    """(N,) share of the segment from node j, in [0, 1]; past the chain's ends it goes on, below 0 and above 1."""
    distance2: Array
    """(N,) squared distance to that place [m²]; past an end, to the line on from it."""


def soft_places(points: Array, nodes: Array, sigma_m: float, outlier_ratio: float) -> tuple[Array, Array]:
    """What the points say of the nodes: weights (M,) and weighted sums of points (M, 3) [m].

    p_mn = exp(-|p_n - x_m|² / 2 sigma²) / (sum_k exp(-|p_n - x_k|² / 2 sigma²) + outlier_ratio): a mixture with an
    outlier class of uniform density, `outlier_ratio` times the peak of a node's Gaussian.
    """
    likely = squared_distances(nodes, points)
    likely *= -0.5 / sigma_m**2
    np.exp(likely, out=likely)
    likely /= likely.sum(axis=0) + outlier_ratio
    return likely.sum(axis=1), likely @ points


def nearest_segment(points: Array, nodes: Array) -> Indices:
    """The segment at the node nearest to each point, (N,)."""
    nearest = np.argmin(squared_distances(points, nodes), axis=1)
    return np.minimum(nearest, len(nodes) - 2)


def assign(points: Array, nodes: Array, around: Indices, first: Indices, window: int) -> Assignment:
    """The nearest place of each point on `around` (N,) or the segment next to it, not beyond `window` of `first` (N,).

    The window is in segments, so in arc length: where the rod crosses itself, a point does not jump to the
    other strand however near that comes.
    """
    last = len(nodes) - 2
    low, high = np.maximum(first - window, 0), np.minimum(first + window, last)
    segment = np.clip(around, low, high)
    raw, t, distance2 = _project(points, nodes, segment)
    onward = np.clip(segment + (raw > 1.0).astype(np.int64) - (raw < 0.0), low, high)
    leaving = np.flatnonzero(onward != segment)
    if len(leaving) > 0:
        _, t_next, distance2_next = _project(points[leaving], nodes, onward[leaving])
        nearer = distance2_next < distance2[leaving]
        moved = leaving[nearer]
        segment[moved], t[moved], distance2[moved] = onward[moved], t_next[nearer], distance2_next[nearer]
    return Assignment(segment=segment, t=t, distance2=distance2)


def _project(points: Array, nodes: Array, segment: Indices) -> tuple[Array, Array, Array]:
    """Share along the line of each point's segment, the same kept to the chain, and squared distance to that place."""
    last = len(nodes) - 2
    edges = np.diff(nodes, axis=0)
    edge = edges[segment]
    off = points - nodes[segment]
    raw = np.einsum("ni,ni->n", off, edge) / np.maximum(np.sum(edges**2, axis=1), 1e-18)[segment]
    t = np.where((segment > 0) & (raw < 0.0), 0.0, raw)
    t = np.where((segment < last) & (t > 1.0), 1.0, t)
    off -= t[:, None] * edge
    return raw, t, np.einsum("ni,ni->n", off, off)


def inlier_probability(distance2: Array, sigma_m: float, limit: float) -> Array:
    """The probability (N,) that a point belongs to the rod, 1 / (1 + exp((d² / sigma² - limit²) / 2)).

    That is a Gaussian of width sigma against a uniform outlier class, whose density is such that a point
    `limit` sigmas away is as likely the one as the other.
    """
    exponent = 0.5 * (distance2 / sigma_m**2 - limit**2)
    return 1.0 / (1.0 + np.exp(np.minimum(exponent, 50.0)))
