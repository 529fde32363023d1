"""Intervals for what benches report: exact ones for success rates, bootstrap ones for other figures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

_RESAMPLES = 10_000


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A figure with its interval."""

    value: float
    low: float | None
    """None where one unit alone gives no interval."""
    high: float | None
    n: int
    """Number of independent units."""


def success_rate(successes: int, n: int, *, confidence: float = 0.95) -> Interval:
    """A success rate with its Clopper-Pearson interval (Biometrika 1934): exact, so never too narrow.

    Raises `InputError` unless 0 ≤ `successes` ≤ `n` and `n` ≥ 1.
    """
    if n < 1 or not 0 <= successes <= n:
        raise InputError(f"{successes} successes of {n}: needed are 0 ≤ successes ≤ n and n ≥ 1.")
    tail = (1.0 - confidence) / 2.0
    from scipy import stats  # here: it takes a third of a second, and most who import this ask for no rate

    low = 0.0 if successes == 0 else float(stats.beta.ppf(tail, successes, n - successes + 1))
    high = 1.0 if successes == n else float(stats.beta.ppf(1.0 - tail, successes + 1, n - successes))
    return Interval(value=successes / n, low=low, high=high, n=n)


def bootstrap(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Callable[[Float64Array], Float64Array] = lambda samples: samples.mean(axis=1),
    confidence: float = 0.95,
) -> Interval:
    """A figure with its percentile bootstrap interval (Efron 1979).

    `values` (n,) are of independent units: runs or cables, never frames of one run. `statistic` maps samples
    (resamples, n) to figures (resamples,). Raises `InputError` for no values, or for one that is not finite.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 1 or len(sample) == 0 or not np.all(np.isfinite(sample)):
        raise InputError(f"A bootstrap needs a list of finite values, one a unit; got {sample.tolist()}.")
    value = float(statistic(sample[None, :])[0])
    if len(sample) == 1:
        return Interval(value=value, low=None, high=None, n=1)
    drawn = sample[rng.integers(len(sample), size=(_RESAMPLES, len(sample)))]
    tail = 100.0 * (1.0 - confidence) / 2.0
    low, high = np.percentile(statistic(drawn), [tail, 100.0 - tail])
    return Interval(value=value, low=float(low), high=float(high), n=len(sample))


def median(values: Sequence[float]) -> Interval:
    """The median with its bootstrap interval; the same values give the same interval."""
    return bootstrap(values, np.random.default_rng(0), statistic=lambda samples: np.median(samples, axis=1))


def without_interval(value: float, n: int) -> Interval:
    """A figure of `n` units of which no interval can be told: a largest value, or units that are not independent."""
    return Interval(value=value, low=None, high=None, n=n)
