"""A row of `result.json` has every figure of the action's record, and none of its shapes."""

import msgspec
import numpy as np

from dlokit.decision.records import ActionFigures, ActionRecord, CorrectionRecord
from dlokit.system.results.run_result import ActionResult, action_result

RECORD = ActionRecord(
    action=1,
    kind="drag",
    grasp_node=7,
    grasp_ok=True,
    slipped=True,
    rmse_m=0.02,
    predicted_rmse_m=0.03,
    prediction_error_m=0.05,
    duration_s=9.0,
    robot_time_s=8.0,
    path_length_m=1.0,
    planning_time_s=0.5,
    corrections=(CorrectionRecord(x_m=0.01, y_m=-0.02, z_m=0.0, yaw_rad=0.3, before_m=0.04, predicted_m=0.03),),
    control_end="no_gain",
    ended_by="lease_lost",
    release_stamp_ns=1,
    nodes_world=np.zeros((31, 3)),
)


def test_a_row_has_every_figure_of_the_record() -> None:
    row = action_result(RECORD)
    assert {name: getattr(row, name) for name in ActionFigures.__struct_fields__} == {
        name: getattr(RECORD, name) for name in ActionFigures.__struct_fields__
    }


def test_a_row_is_json_without_shapes_under_the_names_of_earlier_versions() -> None:
    names = set(msgspec.to_builtins(action_result(RECORD)))
    assert not names & {"nodes_world", "expected_world", "path_world", "release_stamp_ns"}
    assert {"missed_m", "true_rmse_m"} <= names


def test_a_row_of_a_later_version_is_read_without_its_new_figures() -> None:
    row = msgspec.json.encode({**msgspec.to_builtins(action_result(RECORD)), "warmth_k": 300.0})
    assert msgspec.json.decode(row, type=ActionResult) == action_result(RECORD)
