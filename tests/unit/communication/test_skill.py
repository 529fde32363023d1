import inspect

import msgspec
import numpy as np
import pytest

from dlokit.communication.skill import Skill
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Cancelled, Failed, Rejected, Succeeded, TimedOut, Unreachable
from dlokit.types.pose import Pose


def _move(target: Pose, speed_m_s: float = 0.25) -> Float64Array:
    """Move the tool."""
    ...


MOVE = Skill("robot", "move", _move, timeout_s=5.0)
POSE = Pose(position_m=np.array([0.4, 0.0, 0.1]), wxyz=np.array([1.0, 0.0, 0.0, 0.0]))


def test_arguments_come_back_by_name_with_their_defaults() -> None:
    call = MOVE.request("id-1", "id", POSE)
    assert (call.component, call.skill, call.call_id, call.caller) == ("robot", "move", "id-1", "id")
    assert call.schema == MOVE.schema
    arguments = msgspec.structs.asdict(codec.decode(call.arguments, MOVE.arguments_type))
    assert list(arguments) == ["target", "speed_m_s"]
    np.testing.assert_array_equal(arguments["target"].position_m, POSE.position_m)
    assert arguments["speed_m_s"] == 0.25


def test_arguments_that_do_not_fit_are_refused() -> None:
    for wrong in ({}, {"target": 1}, {"target": POSE, "sped_m_s": 0.1}):
        with pytest.raises(CommunicationError, match="cannot decode move_arguments"):
            codec.decode(codec.encode(wrong), MOVE.arguments_type)
    with pytest.raises(CommunicationError, match="missing a required argument: 'target'"):
        MOVE.request("id-1", "id")  # pyright: ignore[reportCallIssue]


def test_a_result_of_another_type_than_declared_is_refused() -> None:
    with pytest.raises(CommunicationError):
        codec.decode(codec.encode(Succeeded(result="there")), MOVE.outcome_type)


@pytest.mark.parametrize(
    "outcome",
    [
        Failed(reason="blocked", detail="by a cup"),
        Rejected(reason="busy"),
        Cancelled(),
        TimedOut(timeout_s=5.0),
        Unreachable(component="robot"),
    ],
    ids=lambda outcome: type(outcome).__name__,
)
def test_every_outcome_crosses_the_bus(outcome: msgspec.Struct) -> None:
    back = codec.decode(codec.encode(outcome), MOVE.outcome_type)
    assert type(back) is type(outcome)
    assert msgspec.structs.asdict(back) == msgspec.structs.asdict(outcome)


def test_a_result_crosses_the_bus() -> None:
    back = codec.decode(codec.encode(Succeeded(result=np.array([1.0, 2.0]))), MOVE.outcome_type)
    assert isinstance(back, Succeeded)
    np.testing.assert_array_equal(back.result, [1.0, 2.0])


def test_a_skill_has_its_component_name_and_description() -> None:
    assert MOVE.key == "robot.move"
    assert inspect.getdoc(_move) == MOVE.doc == "Move the tool."
