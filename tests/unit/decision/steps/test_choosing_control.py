"""Prediction errors of earlier actions when control is chosen."""

import numpy as np
import pytest

from dlokit.decision.records import ActionRecord, CorrectionRecord
from dlokit.decision.steps.act import prediction_error_m

LINE = np.column_stack((np.linspace(0.0, 0.5, 31), np.zeros(31), np.zeros(31)))
CORRECTION = CorrectionRecord(x_m=0.0, y_m=0.0, z_m=0.0, yaw_rad=0.0, before_m=0.01, predicted_m=0.005)


def done(kind: str, off_m: float, **changes: object) -> ActionRecord:
    fields: dict[str, object] = {
        "action": 1,
        "kind": kind,
        "grasp_node": 3,
        "grasp_ok": True,
        "rmse_m": 0.01,
        "predicted_rmse_m": 0.01,
        "duration_s": 1.0,
        "robot_time_s": 1.0,
        "path_length_m": 0.1,
        "planning_time_s": 0.1,
        "release_stamp_ns": 1,
        "nodes_world": LINE + np.array([0.0, off_m, 0.0]),
        "expected_world": LINE,
    }
    return ActionRecord(**{**fields, **changes})  # pyright: ignore[reportArgumentType]


def test_prediction_errors_come_only_from_completed_actions_of_the_same_kind() -> None:
    history = (
        done("drag", 0.03),
        done("drag", 0.04),
        done("lay-down", 0.2),
        done("drag", 0.2, grasp_ok=False),
        done("drag", 0.2, slipped=True),
        done("drag", 0.2, ended_by="lease_lost"),
        done("drag", 0.2, corrections=(CORRECTION,)),
        done("drag", 0.2, expected_world=None),
    )
    assert prediction_error_m(history, "drag") == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2))
    assert prediction_error_m(history, "push") == 0.0
