"""`dlokit call`: parsing of arguments and printing of outcomes."""

import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.app.operate import call
from dlokit.app.operate.call import arguments_from, outcome_line
from dlokit.decision.api import SHAPE_DLO
from dlokit.decision.records import GoalRequest
from dlokit.errors import ConfigError, InputError
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.processes.running import RunningSystem
from dlokit.types.outcome import Failed, Rejected, Succeeded, Unreachable
from dlokit.types.pose import Pose


def test_names_and_values_become_the_types_of_the_skill() -> None:
    assert arguments_from(robot.RELEASE, ("width_m=0.05",)) == {"width_m": 0.05}
    assert arguments_from(SHAPE_DLO, ("goal=S", "threshold_m=0.01")) == {"goal": "S", "threshold_m": 0.01}
    assert arguments_from(robot.HOME, ()) == {}


def test_arrays_and_structures_come_from_json() -> None:
    box = arguments_from(perception.SET_BOX, ("lower_world=[0, 0, 0]", '{"upper_world": [1, 1, 0.5]}'))
    np.testing.assert_array_equal(box["upper_world"], [1.0, 1.0, 0.5])
    assert box["lower_world"].dtype == np.float64
    pose = '{"position_m": [0.5, 0, 0.2], "wxyz": [0, 1, 0, 0]}'
    assert isinstance(arguments_from(robot.MOVE_TO, (f"target={pose}",))["target"], Pose)
    goal = arguments_from(SHAPE_DLO, ('goal={"nodes_world": [[0, 0, 0], [1, 0, 0]], "name": "mine"}',))["goal"]
    assert isinstance(goal, GoalRequest)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (("width_m=wide",), "Expected `float`"),
        (("wide=0.1",), "unexpected keyword argument"),
        (("0.1",), "is not an argument"),
        (("{width_m",), "is not a JSON object"),
    ],
)
def test_invalid_arguments_are_refused_with_the_valid_ones(typed: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        arguments_from(robot.RELEASE, typed)


def test_each_outcome_is_printed_in_one_line() -> None:
    assert outcome_line(Succeeded(result=None)) == "succeeded"
    assert outcome_line(Succeeded(result=1.5)) == "succeeded 1.5"
    assert outcome_line(Failed(reason="stopped", detail="by hand")) == "failed stopped: by hand"
    assert outcome_line(Rejected(reason="not_commander", detail="x")) == "rejected not_commander: x"
    assert outcome_line(Unreachable(component="robot")).startswith("unreachable")


def test_only_a_motion_of_an_arm_can_be_rehearsed() -> None:
    with pytest.raises(InputError, match=r"perception\.look moves no arm"):
        execute(["call", "perception.look", "--dry-run"])
    with pytest.raises(InputError, match="dlokit shape --dry-run"):
        execute(["call", "decision.shape_dlo", "goal=S", "--dry-run"])


def system_with(driver: KinematicRobotConfig, folder: Path, monkeypatch: pytest.MonkeyPatch) -> RunningSystem:
    config = RunConfig(runtime="live", headless=True, camera=RecordedCameraConfig(path="x"), driver=driver)
    monkeypatch.setattr(call, "read_toml", lambda *_: config)
    return RunningSystem(pid=1, began_s=0.0, folder=str(folder), namespace="", endpoint="")


def test_a_motion_of_a_real_arm_asks_an_operator_who_needs_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    real = system_with(RealArmConfig(), tmp_path, monkeypatch)
    for skill in (SHAPE_DLO, robot.HOME, robot.RELEASE.at("opposite")):
        with pytest.raises(ConfigError, match="moves a real arm"):
            call.operator_of(real, skill, confirms=False)
        assert call.operator_of(real, skill, confirms=True) is not None
    assert call.operator_of(real, perception.LOOK, confirms=False) is None
    assert call.operator_of(real, robot.STOP, confirms=False) is None
    software = system_with(KinematicRobotConfig(), tmp_path, monkeypatch)
    assert call.operator_of(software, robot.HOME, confirms=False) is None


@dataclass(frozen=True, kw_only=True)
class RealArmConfig(KinematicRobotConfig):
    """An arm in software that counts as real."""

    name: ClassVar[str] = "real-arm"
    is_real: ClassVar[bool] = True
