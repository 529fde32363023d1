"""Where a cloud ends along the rod, and which of these ends are tips of the rod."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TipConfig:
    """When the end of a cloud is a tip of the rod."""

    length_tolerance: float = 0.06
    """Both ends are tips when the cloud is shorter or longer than the rod by at most this share."""
    snap_m: float = 0.03
    """An end of a cloud that is too short is a tip when it lies so near to one [m]."""
    bin_m: float = 0.005
    """Length of rod over which points are counted [m]."""
    gap_m: float = 0.02
    """A longer stretch without points is a gap [m]."""
    reach_m: float = 0.08
    """How far past the ends of the rod the cloud is searched [m]; about the longest way between two clouds."""


@dataclass(frozen=True, kw_only=True)
class Extent:
    """What the cloud covers of a curve, in its arc length [m]; 0 is at node 0."""

    start_m: float
    end_m: float
    gap_m: tuple[float, float] | None
    """The longest stretch without points in between, if it is one."""


@dataclass(frozen=True, kw_only=True)
class Tips:
    """The tips that are seen: the arc length of each on the curve [m], None where it is not seen."""

    first_m: float | None = None
    last_m: float | None = None
    gap_m: tuple[float, float] | None = None


def extent(s: Array, length_m: float, config: TipConfig) -> Extent | None:
    """What points at arc lengths s (n,) [m] cover; None when they are too few to tell."""
    low = -config.reach_m
    bins = int(np.ceil((length_m + 2 * config.reach_m) / config.bin_m))
    index = ((s - low) / config.bin_m).astype(np.int64)
    counts = np.bincount(index[(index >= 0) & (index < bins)], minlength=bins)
    if np.count_nonzero(counts) < 6:
        return None
    full = counts > 0.2 * np.median(counts[counts > 0])  # a stray point does not cover a bin
    pair = full[:-1] & full[1:]
    runs = np.flatnonzero(pair)
    if len(runs) < 3:
        return None
    start = low + runs[0] * config.bin_m
    end = low + (runs[-1] + 2) * config.bin_m
    covered = np.flatnonzero(full[runs[0] : runs[-1] + 2]) + runs[0]
    jumps = np.diff(covered)
    widest = int(np.argmax(jumps))
    gap = None
    if (jumps[widest] - 1) * config.bin_m > config.gap_m:
        gap = (low + (covered[widest] + 1) * config.bin_m, low + covered[widest + 1] * config.bin_m)
    near = s[(s > start - config.bin_m) & (s < end + config.bin_m)]
    return Extent(start_m=-_edge(-near), end_m=_edge(near), gap_m=gap)


def _edge(s: Array) -> float:
    """Where points with arc lengths s (n,) end at the upper side [m], although noise blurs the end.

    Behind a place s0 well inside, they go on for as long as their density needs to hold the points that lie
    there: s0 + n(s > s0) / density.
    """
    top = float(np.max(s))
    inner, deep = top - 0.012, top - 0.042
    inside = np.count_nonzero((s > deep) & (s <= inner))
    if inside < 5:
        return top
    return min(inner + np.count_nonzero(s > inner) * (inner - deep) / inside, top)


def seen_tips(found: Extent, length_m: float, cut_first: bool, cut_last: bool, config: TipConfig) -> Tips:
    """Which ends of the cloud are tips of a rod of `length_m`; `cut`: something known hides what follows the end.

    Both, when the cloud is as long as the rod. Otherwise an end is one when nothing hides what would follow and it
    lies near to the curve's; of an unbroken cloud that is too short, only the better end.
    """
    misfit = abs(found.end_m - found.start_m - length_m) / length_m
    both = misfit <= config.length_tolerance
    broken = found.gap_m is not None
    if both or (broken and not cut_first and not cut_last and misfit <= 3 * config.length_tolerance):
        return Tips(first_m=found.start_m, last_m=found.end_m, gap_m=found.gap_m)
    off_first, off_last = abs(found.start_m), abs(found.end_m - length_m)
    is_first = not cut_first and off_first <= config.snap_m
    is_last = not cut_last and off_last <= config.snap_m
    if is_first and is_last and not broken:
        is_first, is_last = off_first <= off_last, off_first > off_last
    return Tips(first_m=found.start_m if is_first else None, last_m=found.end_m if is_last else None, gap_m=found.gap_m)


def places_along(rod_m: Array, tips: Tips) -> Array:
    """Where on the curve nodes at rod lengths (M,) [m] lie, given its tips, (M,) [m].

    From each seen tip rod and curve run alike; what does not fit between two tips is taken up by the gap, where
    the curve is least sure, or evenly without one.
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
