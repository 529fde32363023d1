import numpy as np
import pytest
from scipy import stats

from dlokit.errors import InputError
from dlokit.extras.bench.statistics import bootstrap, success_rate


def test_success_rates_have_the_published_clopper_pearson_limits() -> None:
    # The rule of the binomial test inverted: at the limit, the tail holds 2.5 %.
    interval = success_rate(23, 25)

    assert interval.value == pytest.approx(0.92)
    assert interval.low is not None
    assert interval.high is not None
    assert stats.binom.sf(22, 25, interval.low) == pytest.approx(0.025)
    assert stats.binom.cdf(23, 25, interval.high) == pytest.approx(0.025)


def test_no_failure_in_25_still_has_an_upper_limit() -> None:
    interval = success_rate(25, 25)

    assert interval.high == 1.0
    assert interval.low == pytest.approx(0.025 ** (1 / 25))  # closed form when all succeed
    assert success_rate(0, 25).low == 0.0
    assert success_rate(0, 25).high == pytest.approx(1 - 0.025 ** (1 / 25))


@pytest.mark.parametrize(("successes", "n"), [(1, 0), (-1, 5), (6, 5)])
def test_impossible_counts_are_refused(successes: int, n: int) -> None:
    with pytest.raises(InputError, match="0 ≤ successes ≤ n"):
        success_rate(successes, n)


def test_the_bootstrap_agrees_with_the_normal_theory_of_a_mean() -> None:
    values = np.random.default_rng(1).normal(10.0, 2.0, size=200)

    interval = bootstrap(values, np.random.default_rng(2))

    half = 1.96 * values.std() / np.sqrt(200)
    assert interval.value == pytest.approx(values.mean())
    assert interval.low == pytest.approx(values.mean() - half, abs=0.03)  # 10,000 resamples: 0.005 σ of a limit
    assert interval.high == pytest.approx(values.mean() + half, abs=0.03)
    assert interval.n == 200


def test_another_statistic_and_the_seed_are_honoured() -> None:
    values = [1.0, 2.0, 3.0, 100.0, 2.0]

    def medians(samples: np.ndarray) -> np.ndarray:
        return np.median(samples, axis=1)

    first, again = (bootstrap(values, np.random.default_rng(5), statistic=medians) for _ in range(2))

    assert first.value == 2.0
    assert first == again


def test_one_unit_has_no_interval() -> None:
    interval = bootstrap([0.4], np.random.default_rng(0))

    assert (interval.value, interval.low, interval.high, interval.n) == (0.4, None, None, 1)


@pytest.mark.parametrize("values", [[], [0.1, np.nan], [[0.1, 0.2]]])
def test_values_that_are_not_a_list_of_numbers_are_refused(values: list[float]) -> None:
    with pytest.raises(InputError, match="finite values"):
        bootstrap(values, np.random.default_rng(0))
