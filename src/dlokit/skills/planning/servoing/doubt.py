"""Whether a correction is worth it: what it is expected to gain, beside what the doubt of the shape could feign.

A correction moves node i by d_i; the error left at it is e_i, seen with covariance P_i. Its gain in mean square is
(1/M) Σ (2 e_i · d_i - |d_i|²), in which only the first term is seen. Neighbours err alike, so the standard deviations
of that term add up: (2/M) Σ sqrt(d_iᵀ P_i d_i).
"""

from dataclasses import dataclass

import numpy as np

from dlokit.types.arrays import BoolArray, Float64Array

_HIDDEN = 3.0  # times the standard deviation of a node that is seen, measured behind the hand


@dataclass(frozen=True)
class Gain:
    """What a correction is expected to gain."""

    rmse_m: float
    """Less RMSE [m]."""
    square_m2: float
    """Less mean square [m²]."""
    doubt_m2: float
    """Standard deviation of that [m²]."""

    def exceeds(self, doubts: float, least_m: float) -> bool:
        """Whether it is `least_m` of RMSE [m] or more, and more than so many standard deviations."""
        return self.rmse_m >= least_m and self.square_m2 > doubts * self.doubt_m2


def gain(error: Float64Array, by: Float64Array, covariance: Float64Array) -> Gain:
    """The gain of moving nodes `by` (M, 2) [m] that are off by `error` (M, 2) [m], with `covariance` (M, 2, 2) [m²]."""
    before, after = _mean_square(error), _mean_square(error - by)
    variance = np.einsum("ni,nij,nj->n", by, covariance, by)
    return Gain(
        rmse_m=float(np.sqrt(before) - np.sqrt(after)),
        square_m2=before - after,
        doubt_m2=2.0 * float(np.mean(np.sqrt(np.maximum(variance, 0.0)))),
    )


def usual(sd_m: float, visible: BoolArray) -> Float64Array:
    """The covariance (M, 2, 2) [m²] of nodes that are seen to `sd_m` [m] along each axis, those not `visible` worse."""
    return (np.where(visible, sd_m, _HIDDEN * sd_m) ** 2)[:, None, None] * np.eye(2)


def _mean_square(error: Float64Array) -> float:
    return float(np.mean(np.sum(error**2, axis=1)))
