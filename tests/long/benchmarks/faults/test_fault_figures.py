"""Statistics of a sweep of faults."""

import msgspec
import pytest
from scipy import stats

from dlokit.extras.bench.report import BenchFigure
from dlokit.types.flow import RunOutcome
from parts.faults.judging import ALL, RunFinding, all_right, figures
from parts.faults.table import BY_NAME, Fault


def finding(fault: str, **changed: object) -> tuple[Fault, RunFinding]:
    right = RunFinding(
        fault=fault,
        number=0,
        struck=True,
        exit_code=0,
        outcome=RunOutcome.CONVERGED,
        true_rmse_m=0.01,
        threshold_m=0.012,
        stands=True,
        readable=True,
        recovered_after_s=4.0,
    )
    return BY_NAME[fault], msgspec.structs.replace(right, **changed)


def rates(results: list[tuple[Fault, RunFinding]]) -> dict[str, BenchFigure]:
    return {one.case: one for one in figures(results) if one.metric == "ended as it should"}


def test_a_rate_has_its_exact_interval_and_excludes_runs_without_a_fault() -> None:
    results = [finding("kill-camera"), finding("kill-camera", stands=False), finding("kill-camera", struck=False)]
    rate = rates(results)["kill-camera"]
    assert (rate.value, rate.n) == (0.5, 2)
    assert rate.low == pytest.approx(stats.beta.ppf(0.025, 1, 2))
    assert figures(results)[0].value == 1  # not struck


def test_the_control_is_not_counted_among_the_faults() -> None:
    of_all = rates([finding("none", exit_code=None), finding("kill-camera")])[ALL]
    assert (of_all.value, of_all.n) == (1.0, 1)


def test_a_statistic_without_data_is_omitted() -> None:
    metrics = {figure.metric for figure in figures([finding("kill-camera")])}
    assert "median time to recover" in metrics
    assert not any("braking" in metric for metric in metrics)


def test_a_skipped_run_is_neither_correct_nor_wrong_and_a_crashed_one_is_wrong() -> None:
    assert all_right([finding("fill-disk", struck=False, skipped="not here")])
    assert not all_right([finding("fill-disk", struck=False, broken="not_started")])
    assert not all_right([finding("fill-disk", lost_s=3.0)])
