"""Intervals of a bench's figures: exact for success rates, bootstrap for other figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # it loads its statistics module, in a third of a second, at the first figure
from numpy.typing import ArrayLike

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

_RESAMPLES = 10_000
_CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A figure with its interval."""

    value: float
    low: float | None
    """None for a single unit, which gives no interval."""
    high: float | None
    n: int
    """Number of independent units."""


def success_rate(successes: int, n: int) -> Interval:
    """A success rate with its Clopper-Pearson interval (Biometrika 1934): exact, so never too narrow.

    Raises `InputError` unless 0 ≤ `successes` ≤ `n` and `n` ≥ 1.
    """
    if n < 1 or not 0 <= successes <= n:
        raise InputError(f"{successes} successes of {n}: 0 ≤ successes ≤ n and n ≥ 1 are required.")
    exact = scipy.stats.binomtest(successes, n).proportion_ci(_CONFIDENCE)
    return Interval(value=successes / n, low=float(exact.low), high=float(exact.high), n=n)


def bootstrap(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Callable[[Float64Array], Float64Array] = lambda samples: samples.mean(axis=1),
) -> Interval:
    """A figure with its percentile bootstrap interval (Efron 1979).

    `values` (n,) are of independent units: runs or cables, never frames of one run. `statistic` maps samples
    (resamples, n) to figures (resamples,). Raises `InputError` for no values, or for one that is not finite.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 1 or len(sample) == 0 or not np.all(np.isfinite(sample)):
        raise InputError(f"A bootstrap needs a list of finite values, one per unit; got {sample.tolist()}.")
    value = float(statistic(sample[None, :])[0])
    if len(sample) == 1:
        return Interval(value=value, low=None, high=None, n=1)
    limits = scipy.stats.bootstrap(
        (sample,),
        lambda samples, axis: statistic(samples),  # the axis of a sample is the last
        n_resamples=_RESAMPLES,
        vectorized=True,
        confidence_level=_CONFIDENCE,
        method="percentile",
        rng=rng,
    ).confidence_interval
    return Interval(value=value, low=float(limits.low), high=float(limits.high), n=len(sample))


def median(values: Sequence[float]) -> Interval:
    """The median with its bootstrap interval; the same values give the same interval."""
    return bootstrap(values, np.random.default_rng(0), statistic=lambda samples: np.median(samples, axis=1))


def without_interval(value: float, n: int) -> Interval:
    """A figure of `n` units without an interval: a largest value, or units that are not independent."""
    return Interval(value=value, low=None, high=None, n=n)
