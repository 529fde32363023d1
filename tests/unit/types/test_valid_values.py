"""Invalid values are refused on construction, also when a message contains them."""

import math

import msgspec
import numpy as np
import pytest
from robot_bench import Bench, on_bench, reason

from dlokit import geometry
from dlokit.communication.wire import codec
from dlokit.errors import BadValue, CommunicationError
from dlokit.geometry import downward
from dlokit.skills.robot import api
from dlokit.types.action import VelocityProfile
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("position", "wxyz", "named"),
    [
        ((math.nan, 0.0, 0.0), UPRIGHT, "position_m"),
        ((0.0, 0.0, -math.inf), UPRIGHT, "position_m"),
        ((0.0, 0.0), UPRIGHT, r"\(2,\)"),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), "norm"),
        ((0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), "norm"),
        ((0.0, 0.0, 0.0), (1.01, 0.0, 0.0, 0.0), "norm"),
        ((0.0, 0.0, 0.0), (1e200, 0.0, 0.0, 0.0), "norm"),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), r"\(3,\)"),
    ],
)
def test_a_pose_is_finite_with_a_unit_quaternion(
    position: tuple[float, ...], wxyz: tuple[float, ...], named: str
) -> None:
    with pytest.raises(BadValue, match=named):
        Pose(position_m=np.array(position), wxyz=np.array(wxyz))


def test_a_quaternion_typed_with_three_decimals_is_a_unit_quaternion() -> None:
    Pose(position_m=np.zeros(3), wxyz=np.array([0.707, 0.0, 0.707, 0.0]))
    Pose(position_m=np.zeros(3), wxyz=np.array([0.183, 0.365, 0.548, 0.73]))


@pytest.mark.parametrize("wxyz", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 1.0)])
def test_a_quaternion_without_a_direction_is_not_normalised(wxyz: tuple[float, ...]) -> None:
    with pytest.raises(BadValue, match="quaternion"):
        geometry.pose([0.5, 0.0, 0.1], wxyz)


@pytest.mark.parametrize("name", ["speed_m_s", "acceleration_m_s2", "jerk_m_s3"])
@pytest.mark.parametrize("value", [0.0, -0.25, math.inf, math.nan])
def test_a_profile_is_positive_and_finite(name: str, value: float) -> None:
    with pytest.raises(BadValue, match=name):
        VelocityProfile(**{name: value})


def test_a_trajectory_has_a_row_of_joints_for_each_time() -> None:
    times, rows = np.array([0.0, 0.1]), np.zeros((2, 7))
    JointTrajectory(times_s=times, q_rad=rows, dq_rad_s=rows, ddq_rad_s2=rows)
    for wrong in (rows[:1], np.zeros((2, 6)), np.zeros(7), np.zeros((2, 7, 1))):
        with pytest.raises(BadValue, match="shape"):
            JointTrajectory(times_s=times, q_rad=rows, dq_rad_s=wrong, ddq_rad_s2=rows)
    with pytest.raises(BadValue, match="at least one sample"):
        JointTrajectory(times_s=times[:0], q_rad=rows[:0], dq_rad_s=rows[:0], ddq_rad_s2=rows[:0])


def encoded(position: list[float], wxyz: list[float]) -> bytes:
    """A pose as a program without checks would send it."""
    return codec.encode(_Unchecked(position_m=np.array(position), wxyz=np.array(wxyz)))


class _Unchecked(msgspec.Struct):
    position_m: np.ndarray
    wxyz: np.ndarray


@pytest.mark.parametrize("wxyz", [[math.nan] * 4, [0.0] * 4])
def test_a_message_with_an_invalid_value_is_not_decoded(wxyz: list[float]) -> None:
    with pytest.raises(CommunicationError, match="quaternion"):
        codec.decode(encoded([0.5, 0.0, 0.1], wxyz), Pose)
    with pytest.raises(CommunicationError, match="position_m"):
        codec.decode(encoded([math.nan, 0.0, 0.1], list(UPRIGHT)), Pose)


@pytest.mark.parametrize("spoilt", ["quaternion", "speed"])
def test_a_call_with_an_invalid_value_is_rejected_as_bad_arguments(spoilt: str) -> None:
    async def scenario(bench: Bench) -> None:
        target, velocity = downward([0.5, 0.1, 0.1], 0.3), VelocityProfile()
        if spoilt == "quaternion":
            target.wxyz[:] = 0.0  # bypasses the check, as a program without checks would send it
        else:
            msgspec.structs.force_setattr(velocity, "speed_m_s", 0.0)
        outcome = await bench.port.call(api.MOVE_LINEAR, target, velocity)
        assert reason(outcome) == "bad_arguments"
        assert spoilt in str(outcome)
        assert bench.arm.followed == []

    on_bench(scenario)
