"""Where a robot was when a picture was exposed."""

import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.skills.perception.robot_history import FRESH_S, KEPT_S, RobotHistory
from dlokit.types.robot import RobotMode, RobotState

STATE_EVERY_NS = 20_000_000


def state(stamp_ns: int, x_m: float = 0.0, yaw_rad: float = 0.0, *, speed_rad_s: float = 0.5) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        stamp_ns=stamp_ns,
        robot="arm",
        q_rad=np.full(7, x_m),
        dq_rad_s=np.full(7, speed_rad_s),
        T_world_tcp=geometry.downward([x_m, 0.0, 0.2], yaw_rad),
        mode=RobotMode.MOVING,
    )


def test_between_two_states_the_tool_is_between_their_poses() -> None:
    history = RobotHistory()
    for step in range(5):
        history.add(state(step * STATE_EVERY_NS, 0.006 * step, 0.05 * step))  # 0.3 m/s, and 2.5 rad/s
    then = history.at("arm", 2 * STATE_EVERY_NS + 5_000_000)
    assert then is not None
    assert then.stamp_ns == 45_000_000
    np.testing.assert_allclose(then.T_world_tcp.position_m, [0.0135, 0.0, 0.2], atol=1e-12)
    R = geometry.rotation(then.T_world_tcp)
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(0.1125, abs=1e-4)
    np.testing.assert_allclose(then.q_rad, 0.0135, atol=1e-12)


def test_a_turn_through_the_quaternions_sign_is_short() -> None:
    history = RobotHistory()
    history.add(state(0, 0.0, np.pi - 0.02))
    history.add(state(STATE_EVERY_NS, 0.0, -np.pi + 0.02))
    then = history.at("arm", STATE_EVERY_NS // 2)
    assert then is not None
    R = geometry.rotation(then.T_world_tcp)
    assert abs(np.arctan2(R[1, 0], R[0, 0])) == pytest.approx(np.pi, abs=1e-3)


def test_of_a_moving_arm_the_state_is_unknown_until_a_later_one_comes() -> None:
    history = RobotHistory()
    assert history.at("arm", 0) is None
    history.add(state(0))
    assert history.at("arm", 1) is None
    history.add(state(STATE_EVERY_NS))
    assert history.at("arm", 1) is not None


def test_an_arm_at_rest_is_where_it_was_for_a_while() -> None:
    history = RobotHistory()
    resting = state(0, speed_rad_s=0.0)
    history.add(resting)
    assert history.at("arm", round(FRESH_S * 1e9) - 1) is resting
    assert history.at("arm", round(FRESH_S * 1e9)) is None


def test_old_states_are_forgotten_and_the_oldest_one_stands_for_them() -> None:
    history = RobotHistory()
    for step in range(500):
        history.add(state(step * STATE_EVERY_NS, step * 0.001))
    then = history.at("arm", 0)
    assert then is not None
    assert then.stamp_ns == 499 * STATE_EVERY_NS - round(KEPT_S * 1e9)


def test_a_clock_that_was_set_back_begins_anew() -> None:
    history = RobotHistory()
    history.add(state(10 * STATE_EVERY_NS, 1.0))
    history.add(state(2 * STATE_EVERY_NS, 2.0))
    newest = history.newest("arm")
    assert newest is not None
    assert newest.stamp_ns == 2 * STATE_EVERY_NS
    assert history.robots == ("arm",)
