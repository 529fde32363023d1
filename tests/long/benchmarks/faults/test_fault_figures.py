"""Statistics of a sweep of faults."""

import msgspec
import pytest
from scipy import stats

from dlokit.types.flow import RunOutcome
from parts.faults.judging import ALL, RunFinding, all_right, fault_rows, figures
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


def test_a_rate_has_its_exact_interval_and_excludes_runs_without_a_fault() -> None:
    results = [finding("kill-camera"), finding("kill-camera", stands=False), finding("kill-camera", struck=False)]
    row = fault_rows(results)[0]
    assert row.rate is not None
    assert (row.rate.value, row.rate.n) == (0.5, 2)
    assert row.rate.low == pytest.approx(stats.beta.ppf(0.025, 1, 2))


def test_the_control_is_not_counted_among_the_faults() -> None:
    results = [finding("none", exit_code=None), finding("kill-camera")]
    everything = next(row for row in fault_rows(results) if row.name == ALL)
    assert (everything.right, len(everything.judged)) == (1, 1)


def test_a_statistic_without_data_is_omitted() -> None:
    metrics = {figure.metric for figure in figures([finding("kill-camera")])}
    assert "median time to recover" in metrics
    assert not any("braking" in metric for metric in metrics)


def test_a_skipped_run_is_neither_correct_nor_wrong_and_a_crashed_one_is_wrong() -> None:
    assert all_right([finding("fill-disk", struck=False, skipped="not here")])
    assert not all_right([finding("fill-disk", struck=False, broken="not_started")])
    assert not all_right([finding("fill-disk", lost_s=3.0)])
