"""Velocity limits that depend on the angle, as the FR3 has them."""

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import FR3
from dlokit.errors import SkillFailure
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.limits import check_limits, scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import JointTrajectory, RobotReason


def excess(trajectory: JointTrajectory) -> float:
    """Largest ratio of speeds, by differences of the angles, to what Franka's formula allows between the samples.

    Written out here again, joint by joint: sqrt(2 a (end - q)) - offset, not more than the highest speed.
    """
    speeds = np.diff(trajectory.q_rad, axis=0) / np.diff(trajectory.times_s)[:, None]
    q = 0.5 * (trajectory.q_rad[1:] + trajectory.q_rad[:-1])
    near = FR3.limits.slow_near
    assert near is not None
    worst = 0.0
    for joint in range(7):
        for speed, angle in zip(speeds[:, joint], q[:, joint], strict=True):
            left = near.upper_rad[joint] - angle if speed > 0.0 else angle - near.lower_rad[joint]
            allowed = np.sqrt(2.0 * near.deceleration_rad_s2[joint] * left) - near.offset_rad_s[joint]
            worst = max(worst, abs(speed) / min(max(allowed, 1e-9), FR3.limits.velocity_rad_s[joint]))
    return worst


def test_the_first_joint_is_slow_near_its_end_and_only_towards_it():
    q = np.array([2.7, 0.0, 0.0, -1.5, 0.0, 2.0, 0.0])
    up, down = (FR3.limits.velocity_at(q, sign * np.ones(7))[0] for sign in (1.0, -1.0))
    assert up == pytest.approx(np.sqrt(12.0 * (2.7501 - 2.7)) - 0.3)  # 0.48 rad/s, by libfranka's own numbers
    assert down == FR3.limits.velocity_rad_s[0]


@pytest.mark.parametrize("seed", range(8))
def test_joint_moves_over_the_whole_range_keep_them(seed: int):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(FR3.limits.position_lower_rad + 0.02, FR3.limits.position_upper_rad - 0.02, (2, 7))
    move = joint_move(start, end, FR3.limits)
    check_limits(move, FR3.limits)
    assert excess(move) < 1.0


@pytest.mark.parametrize("seed", range(4))
def test_tool_paths_keep_them(seed: int):
    rng, kinematics = np.random.default_rng(seed), ArmKinematics(FR3)
    poses = tuple(
        geometry.downward([x, y, 0.05], yaw)
        for x, y, yaw in zip(
            rng.uniform(0.35, 0.7, 4), rng.uniform(-0.35, 0.35, 4), rng.uniform(-2.4, 0.8, 4), strict=True
        )
    )
    start = kinematics.inverse(poses[0], yaw=Yaw.EITHER)
    try:
        move = tool_move(kinematics, start, poses, VelocityProfile(speed_m_s=0.5))
    except SkillFailure as failure:
        pytest.skip(f"this path leaves the arm's reach: {failure}")
    check_limits(move, FR3.limits)
    assert excess(move) < 1.0


def test_a_motion_that_is_only_too_fast_near_the_end_is_refused_and_named():
    start = np.array([2.0, 0.0, 0.0, -1.5, 0.0, 2.0, 0.0])
    end = start + np.array([0.74, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    good = joint_move(start, end, FR3.limits)
    fast = scaled(good, 1.03)
    with pytest.raises(SkillFailure, match="joint 1") as failure:
        check_limits(fast, FR3.limits)
    assert failure.value.reason is RobotReason.VELOCITY_LIMIT
    assert np.abs(fast.dq_rad_s).max() < FR3.limits.velocity_rad_s[0], "by the fixed limit it would have passed"
