"""Correct ends of a run with an injected fault."""

import msgspec
import pytest

from dlokit.types.flow import RunOutcome
from parts.faults.judging import RunFinding, faults_of
from parts.faults.table import BY_NAME

CONVERGED = RunFinding(
    fault="kill-camera",
    number=0,
    struck=True,
    exit_code=0,
    outcome=RunOutcome.CONVERGED,
    rmse_m=0.009,
    true_rmse_m=0.010,
    threshold_m=0.012,
    stands=True,
    readable=True,
)
CAMERA = BY_NAME["kill-camera"]


def test_a_run_that_converges_with_the_arm_at_rest_and_no_process_left_is_correct() -> None:
    assert faults_of(CONVERGED, CAMERA) == ()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"exit_code": None}, "it did not end"),
        ({"outcome": RunOutcome.FAILED, "reason": "no_dlo"}, "it ended as failed, no_dlo instead of converged"),
        ({"outcome": None, "exit_code": 1}, "it ended as exit code 1 without a result instead of converged"),
        ({"stands": False}, "the arm was not at rest at the end"),
        ({"remaining_processes": ("python -m dlokit…",)}, "1 processes remained"),
        ({"true_rmse_m": 0.0145}, "it converged falsely: 9.0 mm by its estimate, 14.5 mm in truth"),
        ({"readable": False}, "its recording cannot be read"),
        ({"lost_s": 1.2}, "its recording lacks 1.2 s"),
    ],
)
def test_every_violation_is_named(changed: dict[str, object], said: str) -> None:
    assert faults_of(msgspec.structs.replace(CONVERGED, **changed), CAMERA) == (said,)


def test_a_failure_is_correct_only_with_the_expected_name() -> None:
    died = msgspec.structs.replace(CONVERGED, outcome=RunOutcome.FAILED, reason="process_died: cell", exit_code=3)
    assert faults_of(died, BY_NAME["kill-cell"]) == ()
    assert faults_of(died, BY_NAME["kill-robot"]) != ()


def test_an_arm_lost_with_its_cell_need_not_report_standstill() -> None:
    gone = msgspec.structs.replace(
        CONVERGED, outcome=RunOutcome.FAILED, reason="process_died: cell", stands=None, exit_code=3
    )
    assert faults_of(gone, BY_NAME["kill-cell"]) == ()


def test_an_arm_in_motion_must_brake_where_its_commander_is_lost() -> None:
    lost = BY_NAME["freeze-decision"]
    assert faults_of(msgspec.structs.replace(CONVERGED, moved=True, braked_s=0.2), lost) == ()
    assert faults_of(msgspec.structs.replace(CONVERGED, moved=True), lost) == ("the arm did not brake",)
    assert faults_of(msgspec.structs.replace(CONVERGED, moved=True), CAMERA) == ()


NAMED = msgspec.structs.replace(CONVERGED, exit_code=1, incomplete=True, readable=False)


def test_a_run_whose_disk_refuses_files_ends_with_its_outcome_and_a_sentence() -> None:
    assert faults_of(NAMED, BY_NAME["full-disk"]) == ()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"exit_code": 0}, "its exit code is 0 instead of 1"),
        ({"incomplete": False}, "it did not say which files are missing"),
        ({"traceback": True}, "it printed a traceback"),
        ({"outcome": None}, "it ended as exit code 1 without a result instead of converged"),
    ],
)
def test_every_violation_of_a_run_without_a_disk_is_named(changed: dict[str, object], said: str) -> None:
    assert faults_of(msgspec.structs.replace(NAMED, **changed), BY_NAME["full-disk"]) == (said,)
