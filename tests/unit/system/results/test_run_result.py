import json
import math
from pathlib import Path

import msgspec
import pytest
from made_results import PROTECTED

from dlokit.decision.records import CorrectionRecord
from dlokit.errors import InputError
from dlokit.system.results.run_result import (
    ActionResult,
    RunResult,
    config_hash,
    protection_result,
    read_result,
    write_result,
)
from dlokit.types.flow import RunOutcome

FIELDS = [
    *(
        "outcome",
        "reason",
        "goal",
        "actions",
        "rmse_m",
        "start_rmse_m",
        "true_rmse_m",
        "true_largest_m",
        "passing",
        "true_passing",
        "largest_fixture_force_n",
        "fixture_contact",
        "threshold_m",
        "seed",
        "sim_time_s",
    ),
    *("wall_time_s", "planning_time_s", "history", "config_hash", "version", "episode", "goal_verdict", "camera"),
    *("twin", "interruptions", "recoveries", "protections", "task", "tasks"),
]
ACTION_FIELDS = [
    *("action", "kind", "grasp_node", "grasp_ok", "slipped", "rmse_m", "predicted_rmse_m", "missed_m", "duration_s"),
    *("robot_time_s", "path_length_m", "planning_time_s", "corrections", "control_end", "ended_by", "true_rmse_m"),
]
ACTION = ActionResult(
    action=1,
    kind="lay-down",
    grasp_node=30,
    grasp_ok=True,
    rmse_m=0.0085,
    predicted_rmse_m=0.007,
    duration_s=12.0,
    robot_time_s=11.0,
    path_length_m=1.5,
    planning_time_s=0.2,
)


def _result() -> RunResult:
    return RunResult(
        outcome=RunOutcome.CONVERGED,
        actions=1,
        rmse_m=0.0085,
        threshold_m=0.012,
        seed=3,
        sim_time_s=20.5,
        wall_time_s=9.0,
        planning_time_s=0.2,
        history=(ACTION,),
        config_hash=config_hash("seed = 3"),
        version="0.1.0",
    )


def test_the_file_has_the_promised_fields_in_order(tmp_path: Path) -> None:
    write_result(tmp_path, _result())
    written = json.loads((tmp_path / "result.json").read_text())

    assert list(written) == FIELDS
    assert list(written["history"][0]) == ACTION_FIELDS
    assert written["outcome"] == "converged"
    assert written["reason"] is None
    assert written["true_rmse_m"] is None


def test_a_result_is_read_as_written(tmp_path: Path) -> None:
    write_result(tmp_path, _result())

    assert read_result(tmp_path) == _result()
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_what_was_set_on_an_arm_is_written_with_what_the_arm_reported(tmp_path: Path) -> None:
    result = msgspec.structs.replace(_result(), protections=(protection_result(PROTECTED),))
    write_result(tmp_path, result)
    (written,) = json.loads((tmp_path / "result.json").read_text())["protections"]
    assert written == {
        "robot": "first",
        "recovered": True,
        "torque_nm": 20.0,
        "force_n": 30.0,
        "load_kg": 0.25,
        "load_at_m": [0.0, 0.0, 0.1034],
        "reported_load_kg": 0.25,
        "reported_tool_kg": 0.73,
        "reported_tool_m": [0.0, 0.0, 0.1034],
        "reported_tool_wxyz": pytest.approx([0.924, 0.0, 0.0, -0.383], abs=1e-3),
    }
    assert read_result(tmp_path) == result


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_figure_that_json_cannot_hold_is_refused(tmp_path: Path, value: float) -> None:
    with pytest.raises(InputError, match="rmse_m of a result is"):
        write_result(tmp_path, msgspec.structs.replace(_result(), rmse_m=value))
    row = msgspec.structs.replace(_result().history[0], duration_s=value)
    with pytest.raises(InputError, match="duration_s of a result is"):
        write_result(tmp_path, msgspec.structs.replace(_result(), history=(row,)))
    done = CorrectionRecord(x_m=0.01, y_m=0.0, z_m=0.0, yaw_rad=0.0, before_m=0.03, predicted_m=0.02, seen_m=value)
    row = msgspec.structs.replace(_result().history[0], corrections=(done,))
    with pytest.raises(InputError, match="seen_m of a result is"):
        write_result(tmp_path, msgspec.structs.replace(_result(), history=(row,)))


@pytest.mark.parametrize(("content", "message"), [(None, "has ended"), ("{}", "run it again"), ("[", "run it again")])
def test_a_folder_without_a_result_is_one_clear_error(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "result.json").write_text(content)

    with pytest.raises(InputError, match=message):
        read_result(tmp_path)


def test_the_hash_names_the_configuration() -> None:
    assert config_hash("a = 1") == config_hash("a = 1")
    assert config_hash("a = 1") != config_hash("a = 2")
    assert len(config_hash("")) == 12
