"""Find the ends of a cloud along the rod, and decide which of them are tips of the rod."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dlokit.skills.observer.initialise.first_shape import LENGTH_TOLERANCE
from dlokit.types.arrays import Float64Array

SNAP_M = 0.12
"""Largest distance of an unhidden end of a cloud from the chain's tip for it to count as a tip [m]."""
SNAP_BLIND_M = 0.03
"""The same distance if the occlusion is unknown [m]."""
_BIN_M = 0.005
"""Length of rod over which points are counted [m]."""
_GAP_M = 0.02
"""A longer stretch without points is a gap [m]."""
_REACH_M = 0.08
"""The cloud is searched this far past the ends of the rod [m]; about the largest motion between two clouds."""


@dataclass(frozen=True, kw_only=True)
class Extent:
    """The part of a curve that the cloud covers, in arc length [m]; 0 is at node 0."""

    start_m: float
    end_m: float
    gap_m: tuple[float, float] | None
    """The longest stretch without points, if it is long enough for a gap."""


@dataclass(frozen=True, kw_only=True)
class Tips:
    """The seen tips: the arc length of each on the curve [m]; None if it is not seen."""

    first_m: float | None = None
    last_m: float | None = None
    gap_m: tuple[float, float] | None = None


def extent(s: Float64Array, length_m: float) -> Extent | None:
    """The interval that points at arc lengths s (n,) [m] cover; None when there are too few points."""
    bins = int(np.ceil((length_m + 2 * _REACH_M) / _BIN_M))
    start, end, low, high = _extent(s, -_REACH_M, _BIN_M, bins)
    if np.isnan(start):
        return None
    return Extent(start_m=start, end_m=end, gap_m=(low, high) if high - low > _GAP_M else None)


@njit(cache=True)
def _extent(s: Float64Array, low: float, bin_m: float, bins: int) -> tuple[float, float, float, float]:
    """Start and end of the points, and of the longest stretch without points; NaN if there are too few points."""
    nothing = (np.nan, np.nan, np.nan, np.nan)
    counts = np.zeros(bins)
    for place in s:
        index = int((place - low) / bin_m)
        if place >= low and index < bins:
            counts[index] += 1.0
    filled = counts[counts > 0.0]
    if filled.shape[0] < 6:
        return nothing
    full = counts > 0.2 * np.median(filled)  # a stray point does not cover a bin
    first, last, runs = bins, 0, 0
    for k in range(bins - 1):
        if full[k] and full[k + 1]:
            first, last, runs = min(first, k), k + 1, runs + 1
    if runs < 3:
        return nothing
    begin, widest, gap = first, 0, first
    for k in range(first, last + 1):
        if full[k]:
            if k - begin > widest:
                widest, gap = k - begin, begin
            begin = k
    start, end = low + first * bin_m, low + (last + 1) * bin_m
    near = s[(s > start - bin_m) & (s < end + bin_m)]
    return -_edge(-near), _edge(near), low + (gap + 1) * bin_m, low + (gap + widest) * bin_m


@njit(cache=True)
def _edge(s: Float64Array) -> float:
    """Upper end of points with arc lengths s (n,) [m], corrected for noise, which blurs the end.

    The number of points past a place s0 well before the end, divided by their density, gives the length past s0: the
    end is s0 + n(s > s0) / density.
    """
    top = np.max(s)
    inner, deep = top - 0.012, top - 0.042
    before, past = 0, 0
    for place in s:
        if place > inner:
            past += 1
        elif place > deep:
            before += 1
    if before < 5:
        return top
    return min(inner + past * (inner - deep) / before, top)


def seen_tips(found: Extent, length_m: float, cut_first: bool, cut_last: bool, snap_m: float) -> Tips:
    """Which ends of the cloud are tips of a rod of `length_m`; `cut`: its continuation is known to be hidden.

    Both ends are tips when the cloud is unbroken and as long as the rod. (Across a gap the length is the chain's own,
    and no evidence.) Otherwise an end is a tip when nothing hides its continuation and it is within `snap_m` of the
    chain's tip; of an unbroken cloud that is too short, only the better end is.
    """
    misfit = abs(found.end_m - found.start_m - length_m) / length_m
    broken = found.gap_m is not None
    if not broken and misfit <= LENGTH_TOLERANCE:
        return Tips(first_m=found.start_m, last_m=found.end_m)
    off_first, off_last = abs(found.start_m), abs(found.end_m - length_m)
    is_first = not cut_first and off_first <= snap_m
    is_last = not cut_last and off_last <= snap_m
    if is_first and is_last and not broken:
        is_first, is_last = off_first <= off_last, off_first > off_last
    return Tips(first_m=found.start_m if is_first else None, last_m=found.end_m if is_last else None, gap_m=found.gap_m)


def places_along(rod_m: Float64Array, tips: Tips) -> Float64Array:
    """Arc lengths on the curve (M,) [m] of nodes at rod lengths (M,) [m], given its tips.

    From each seen tip, arc lengths on rod and curve are equal; a difference between two tips is put into the gap, where
    the curve is least certain, or spread evenly without one.
    """
    length = float(rod_m[-1])
    if tips.first_m is not None and tips.last_m is not None:
        shift = tips.last_m - length
        if tips.gap_m is None:
            return tips.first_m + rod_m * ((tips.last_m - tips.first_m) / length)
        low, high = tips.gap_m
        known = np.maximum.accumulate([0.0, low - tips.first_m, high - shift, length])
        return np.interp(rod_m, known + 1e-9 * np.arange(4), [tips.first_m, low, high, tips.last_m])
    if tips.first_m is not None:
        return rod_m + tips.first_m
    return rod_m + (tips.last_m - length if tips.last_m is not None else 0.0)
