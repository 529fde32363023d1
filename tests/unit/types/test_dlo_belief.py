"""Figures that are known to a factor."""

import math

import pytest

from dlokit.types.dlo import LogNormal


def test_an_interval_is_a_factor_to_either_side() -> None:
    low, high = LogNormal(value=2.0, log_sd=0.1).interval()
    assert low * high == pytest.approx(4.0)
    assert high / 2.0 == pytest.approx(math.exp(0.2))


def test_two_figures_that_agree_are_surer_together() -> None:
    together = LogNormal(value=1.0, log_sd=0.01).fused_with(LogNormal(value=1.01, log_sd=0.01))
    assert together.value == pytest.approx(math.sqrt(1.01))
    assert together.log_sd == pytest.approx(0.01 / math.sqrt(2.0))


def test_a_measured_figure_that_contradicts_takes_the_place() -> None:
    measured = LogNormal(value=0.5, log_sd=0.01)
    assert LogNormal(value=0.4, log_sd=0.01).fused_with(measured) is measured
    certain = LogNormal(value=0.505, log_sd=0.0)
    assert certain.fused_with(measured) is certain
    assert LogNormal(value=0.4, log_sd=0.0).fused_with(measured) is measured
