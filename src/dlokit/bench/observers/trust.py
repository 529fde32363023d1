"""Whether an observer knows how wrong it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from dlokit.types.arrays import Float64Array

FLAGGED_WITHIN = 5
"""A loss must show in the health within so many frames."""


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Rows of lost frames in one sequence, and how many of them the observer's health told."""

    count: int
    flagged: int


def rank_correlation(stated: Float64Array, errors: Float64Array) -> float | None:
    """Spearman's correlation of what was stated (N,) and errors (N,), where both are finite; None without a spread."""
    known = np.isfinite(stated) & np.isfinite(errors)
    if np.count_nonzero(known) < 3:
        return None
    a, b = rankdata(stated[known]), rankdata(errors[known])
    if np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def losses(lost: NDArray[np.bool_], health: Float64Array, lost_health: float) -> Losses:
    """Rows of lost frames (T,), and those whose health (T,) is below `lost_health` within `FLAGGED_WITHIN` frames.

    A row that begins so late that the sequence ends before does not count.
    """
    before = np.concatenate(([False], lost[:-1]))
    starts = np.flatnonzero(lost & ~before)
    starts = starts[starts + FLAGGED_WITHIN < len(lost)]
    low = [bool(np.any(health[start : start + FLAGGED_WITHIN + 1] < lost_health)) for start in starts]
    return Losses(count=len(low), flagged=sum(low))
