"""A motion that is only checked: as the robot's own, from where the arm is, and with nothing moved."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.description.arm.franka import PANDA
from dlokit.functional.robots.gate import GateConfig
from dlokit.geometry import downward
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.rehearsal import rehearsed
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import FIRST_ROBOT, RobotState

SECOND = "second"

CONFIG = RunConfig(runtime="live", headless=True)
AWAY_RAD = PANDA.home_q_rad + np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2])
TARGET = downward([0.5, 0.1, 0.1], 0.3)


def standing(q_rad: Float64Array = AWAY_RAD, *, latched: bool = False) -> dict[str, RobotState]:
    state = structs.replace(
        ARM_AT_REST,
        stamp_ns=77_000_000_000,
        q_rad=q_rad,
        T_world_tcp=tcp_pose(PANDA, q_rad),
        finger_width_m=0.03,
        stop_latched=latched,
    )
    return {FIRST_ROBOT: state}


def test_a_motion_begins_where_the_arm_is_and_takes_as_long_as_the_real_one() -> None:
    done = rehearsed(CONFIG, standing(), robot.MOVE_TO, {"target": TARGET})
    assert isinstance(done.outcome, Succeeded)
    np.testing.assert_allclose(done.ends.T_world_tcp.position_m, TARGET.position_m, atol=1e-4)
    assert done.ends.finger_width_m == pytest.approx(0.03)
    assert done.duration_s > 0.5
    slow = replace(CONFIG, gate=GateConfig(speed_scale=0.25))
    slower = rehearsed(slow, standing(), robot.MOVE_TO, {"target": TARGET})
    assert slower.duration_s == pytest.approx(4.0 * done.duration_s, rel=0.05)
    from_home = rehearsed(CONFIG, standing(PANDA.home_q_rad), robot.HOME, {})
    assert from_home.duration_s < 0.1


def test_the_gate_and_a_stop_refuse_it_as_they_would() -> None:
    out = rehearsed(CONFIG, standing(), robot.MOVE_TO, {"target": downward([0.5, 0.1, 0.75], 0.0)})
    assert isinstance(out.outcome, Failed)
    assert out.outcome.reason in ("outside_workspace", "unreachable")
    stopped = rehearsed(CONFIG, standing(latched=True), robot.HOME, {})
    assert isinstance(stopped.outcome, Rejected)
    assert stopped.outcome.reason == "stop_latched"


def test_two_arms_keep_their_distance_in_it_too() -> None:
    two = replace(CONFIG, arms=2)
    states = standing() | {SECOND: msgspec.structs.replace(standing()[FIRST_ROBOT], robot=SECOND)}
    done = rehearsed(two, states, robot.HOME.at(SECOND), {})
    assert isinstance(done.outcome, Succeeded), done.outcome
    assert done.ends.robot == SECOND
