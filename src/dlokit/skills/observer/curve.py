"""The centre line of a thin cloud: a smooth curve fitted to points near a guide."""

from dataclasses import dataclass

import numpy as np
import scipy

from dlokit.geometry import arc_lengths
from dlokit.skills.observer.visibility import RADIUS_M, thickness
from dlokit.types.arrays import BoolArray, Float64Array

STEP_M = 0.002  # spacing of the fitted polyline [m]: a tenth of the smallest bend radius in use


REACH_M = 0.02
"""Points farther from the guide than this do not belong to the DLO [m]; also the search distance past the ends."""
_SPREAD_M = 0.008
"""Points farther from the fitted curve than this are outliers [m]: radius and three times the noise."""
_SMOOTHING_M = 0.012
"""Bends shorter than this count as noise [m]."""
_BIN_M = 0.005
"""Length of curve over which points are averaged [m]."""
_GAP_M = 0.02
"""A stretch without points is a gap when it is longer than this [m]."""
ITERATIONS = 3
"""Number of iterations in which the curve becomes the next guide."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A stretch of curve with points, from `start_m` to `end_m` of its arc length."""

    start_m: float
    end_m: float


@dataclass(frozen=True, kw_only=True)
class FittedCurve:
    """A centre line as a dense polyline, with the stretches that were seen."""

    points: Float64Array
    """(K, 3) [m], about 2 mm apart; extends a little past the seen stretches."""
    s_m: Float64Array
    """(K,) arc length from the first point [m]."""
    segments: tuple[Segment, ...]
    """The seen stretches, in order; never empty."""
    used: BoolArray
    """(N,) which points of the cloud belong to the curve."""

    def at(self, s_m: Float64Array) -> Float64Array:
        """Positions (n, 3) [m] at arc lengths (n,) [m]; past an end, straight on."""
        return polyline_at(self.points, self.s_m, s_m)


def polyline_at(points: Float64Array, s_m: Float64Array, wanted_m: Float64Array) -> Float64Array:
    """Positions (n, 3) at arc lengths of a polyline; past an end, straight on along its last 2 cm."""
    result = np.column_stack([np.interp(wanted_m, s_m, points[:, axis]) for axis in range(points.shape[1])])
    reach = 0.02
    for end, sign in ((0, 1.0), (-1, -1.0)):
        past = sign * (s_m[end] - wanted_m)
        inner = np.array([np.interp(s_m[end] + sign * reach, s_m, points[:, axis]) for axis in range(3)])
        direction = points[end] - inner
        direction /= max(float(np.linalg.norm(direction)), 1e-9)
        result[past > 0] = points[end] + past[past > 0, None] * direction
    return result


def project(points: Float64Array, polyline: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Arc length of the nearest place on a polyline (K, 3) to each point (N, 3), and the distance; both (N,).

    The spacing of the polyline must be small compared with its distance to itself: only the two edges at the nearest
    vertex are searched.
    """
    s = arc_lengths(polyline)
    _, nearest = scipy.spatial.KDTree(polyline).query(points)
    best_s, best_d2 = s[nearest], np.sum((points - polyline[nearest]) ** 2, axis=1)
    for offset in (-1, 0):
        a = np.clip(nearest + offset, 0, len(polyline) - 2)
        edge = polyline[a + 1] - polyline[a]
        t = np.sum((points - polyline[a]) * edge, axis=1) / np.maximum(np.sum(edge**2, axis=1), 1e-18)
        t = np.clip(t, 0.0, 1.0)
        d2 = np.sum((points - polyline[a] - t[:, None] * edge) ** 2, axis=1)
        better = d2 < best_d2
        best_d2 = np.where(better, d2, best_d2)
        best_s = np.where(better, s[a] + t * (s[a + 1] - s[a]), best_s)
    return best_s, np.sqrt(best_d2)


def dense(polyline: Float64Array, past_m: float) -> Float64Array:
    """A polyline (K, 3) [m] at steps of 2 mm (L, 3), lengthened straight on by `past_m` at both ends."""
    s = arc_lengths(polyline)
    count = max(int(np.ceil((s[-1] + 2 * past_m) / STEP_M)), 2)
    return polyline_at(polyline, s, np.linspace(-past_m, s[-1] + past_m, count + 1))


def fit_curve(
    points: Float64Array,
    guide: Float64Array,
    *,
    reach_m: float = REACH_M,
    iterations: int = ITERATIONS,
    radius_m: float = RADIUS_M,
) -> FittedCurve | None:
    """The centre line of a cloud (N, 3) [m] near a guide (K, 3) [m] that runs along it, or None.

    Each iteration projects the points on the guide, averages them over short bins of arc length, and smooths the
    averages by a cubic spline with a penalty on its second derivative. The curve is the next guide, extended at both
    ends to reach points past them. None when too few points are near the guide. All lengths of this module, and
    `reach_m`, are those of a DLO of 4 mm radius; they grow with its thickness.
    """
    scale = thickness(radius_m)
    points, polyline, limit = points / scale, guide / scale, reach_m
    for _ in range(iterations):
        smooth = _smoothed(points, dense(polyline, reach_m), limit)
        if smooth is None:
            return None
        polyline, limit = smooth, _SPREAD_M
    polyline = dense(polyline, reach_m)
    s, distance = project(points, polyline)
    length = arc_lengths(polyline)[-1]
    used = (distance < _SPREAD_M) & (s > 0.0) & (s < length)
    segments = _segments(s[used], length)
    if not segments:
        return None
    return FittedCurve(
        points=scale * polyline,
        s_m=scale * arc_lengths(polyline),
        segments=tuple(Segment(start_m=scale * one.start_m, end_m=scale * one.end_m) for one in segments),
        used=used,
    )


def _smoothed(points: Float64Array, guide: Float64Array, limit_m: float) -> Float64Array | None:
    """The smoothed averages of the points near a dense guide, over the stretch they cover; None if too few."""
    s, distance = project(points, guide)
    length = arc_lengths(guide)[-1]
    near = (distance < limit_m) & (s > 0.0) & (s < length)
    covered = _segments(s[near], length)
    if not covered:
        return None
    first, last = covered[0].start_m, covered[-1].end_m
    inside = near & (s >= first) & (s <= last)
    s, X = s[inside], points[inside]
    bins = np.floor((s - first) / _BIN_M).astype(np.int64)
    counts = np.bincount(bins)
    full = counts > 0
    if np.count_nonzero(full) < 5:
        return None

    def mean(values: Float64Array) -> Float64Array:
        return np.bincount(bins, weights=values)[full] / counts[full]

    means = np.column_stack([mean(X[:, axis]) for axis in range(3)])
    # In units of the smoothing length and with weights of one per unit of length, the penalty is 1.
    weights = np.minimum(counts[full] / np.median(counts[full]), 3.0) * _BIN_M / _SMOOTHING_M
    spline = scipy.interpolate.make_smoothing_spline(mean(s) / _SMOOTHING_M, means, weights, lam=1.0)
    steps = max(int(np.ceil((last - first) / STEP_M)), 2)
    return np.asarray(spline(np.linspace(first, last, steps + 1) / _SMOOTHING_M), dtype=np.float64)


def _segments(s: Float64Array, length_m: float) -> tuple[Segment, ...]:
    """The stretches of arc length that points cover, separated by gaps longer than `_GAP_M`."""
    if len(s) < 10:
        return ()
    width = _BIN_M
    counts = np.bincount(np.clip((s / width).astype(np.int64), 0, None), minlength=int(np.ceil(length_m / width)))
    # A stray point does not cover a bin: a covered one has at least a fifth of the usual number.
    covered = np.flatnonzero(counts > 0.2 * np.median(counts[counts > 0]))
    breaks = np.flatnonzero(np.diff(covered) > _GAP_M / width) + 1
    found: list[Segment] = []
    for run in np.split(covered, breaks):
        low, high = run[0] * width, (run[-1] + 1) * width
        inside = s[(s >= low - width) & (s <= high + width)]
        if len(run) >= 2 and len(inside) >= 5:
            found.append(Segment(start_m=-_edge(-inside), end_m=_edge(inside)))
    return tuple(found)


def _edge(s: Float64Array) -> float:
    """Upper end of a stretch of points with arc lengths s (n,) [m].

    Noise blurs the end symmetrically. The number of points past a place s0 well before the end, divided by their
    density, gives the length past s0: the end is s0 + n(s > s0) / density.
    """
    top = float(np.quantile(s, 1.0 - min(2.0 / len(s), 0.5)))
    inner, deep = top - 0.008, top - 0.038
    inside = s[(s > deep) & (s <= inner)]
    if len(inside) < 5:
        return top
    density = len(inside) / (inner - max(deep, float(s.min())))
    estimate = inner + np.count_nonzero(s > inner) / density
    return float(np.clip(estimate, top - 0.006, s.max()))
