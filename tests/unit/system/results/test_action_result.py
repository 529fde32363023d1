import msgspec
import numpy as np
import pytest

from dlokit.decision.records import ActionRecord, CorrectionRecord
from dlokit.system.results.run_result import CorrectionResult, action_result


def _record(corrections: tuple[CorrectionRecord, ...], control_end: str) -> ActionRecord:
    return ActionRecord(
        action=1,
        kind="drag",
        grasp_node=7,
        grasp_ok=True,
        rmse_m=0.02,
        predicted_rmse_m=0.03,
        duration_s=9.0,
        robot_time_s=8.0,
        path_length_m=1.0,
        planning_time_s=0.5,
        release_stamp_ns=1,
        nodes_world=np.zeros((31, 3)),
        corrections=corrections,
        control_end=control_end,
    )


def test_the_result_has_the_figures_of_control() -> None:
    done = CorrectionRecord(
        displacement=np.array([0.01, -0.02, 0.0, 0.3]), before_m=0.04, predicted_m=0.03, seen_m=None
    )
    row = action_result(_record((done,), "no_gain"))
    assert row.corrections == (
        CorrectionResult(x_m=0.01, y_m=-0.02, z_m=0.0, yaw_rad=0.3, before_m=0.04, predicted_m=0.03, seen_m=None),
    )
    assert row.control_end == "no_gain"


def test_an_action_without_control_has_a_reason() -> None:
    row = action_result(_record((), ""))
    assert row.corrections == ()
    assert row.control_end is None


@pytest.mark.parametrize(("ended_by", "told"), [("", None), ("lease_lost", "lease_lost")])
def test_the_early_end_of_an_action_is_named(ended_by: str, told: str | None) -> None:
    assert action_result(msgspec.structs.replace(_record((), ""), ended_by=ended_by)).ended_by == told


def test_the_result_has_the_prediction_error_if_there_was_a_prediction() -> None:
    record = _record((), "")
    assert action_result(record).prediction_error_m is None
    beside = msgspec.structs.replace(record, expected_world=np.tile([0.03, 0.04, 0.0], (31, 1)))
    assert action_result(beside).prediction_error_m == pytest.approx(0.05)
