"""`dlokit call`: parsing of arguments and printing of outcomes."""

import numpy as np
import pytest

from dlokit.app.operate.call import arguments_from, outcome_line
from dlokit.decision.api import SHAPE_DLO
from dlokit.decision.records import GoalRequest
from dlokit.errors import InputError
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
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
