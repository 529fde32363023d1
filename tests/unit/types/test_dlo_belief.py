"""Figures that are known to a factor."""

import math

import pytest

from dlokit.types.dlo import Figure


def test_an_interval_is_a_factor_to_either_side() -> None:
    low, high = Figure(value=2.0, log_sd=0.1).between()
    assert low * high == pytest.approx(4.0)
    assert high / 2.0 == pytest.approx(math.exp(0.2))


def test_two_figures_that_agree_are_surer_together() -> None:
    together = Figure(value=1.0, log_sd=0.01).with_measured(Figure(value=1.01, log_sd=0.01))
    assert together.value == pytest.approx(math.sqrt(1.01))
    assert together.log_sd == pytest.approx(0.01 / math.sqrt(2.0))


def test_a_measured_figure_that_contradicts_takes_the_place() -> None:
    measured = Figure(value=0.5, log_sd=0.01)
    assert Figure(value=0.4, log_sd=0.01).with_measured(measured) is measured
    certain = Figure(value=0.505, log_sd=0.0)
    assert certain.with_measured(measured) is certain
    assert Figure(value=0.4, log_sd=0.0).with_measured(measured) is measured
