"""Trajectories keep the limits, start and end at rest, and follow their path."""

import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.errors import SkillFailure
from dlokit.geometry import downward, matrix
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.limits import check_limits
from dlokit.motion.planned_motion import planned
from dlokit.motion.tool_path import half_turned
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory

KINEMATICS = ArmKinematics(PANDA)
PROFILE = VelocityProfile()


def raised(T: Pose, height_m: float) -> Pose:
    return Pose(position_m=T.position_m + np.array([0.0, 0.0, height_m]), wxyz=T.wxyz)


def tool_track(trajectory: JointTrajectory) -> np.ndarray:
    return np.array([KINEMATICS.forward(q).position_m for q in trajectory.q_rad])


def check_trajectory(trajectory: JointTrajectory) -> None:
    assert planned(KINEMATICS, lambda: trajectory) is trajectory


def assert_at_rest_at_both_ends(trajectory: JointTrajectory) -> None:
    np.testing.assert_allclose(trajectory.dq_rad_s[[0, -1]], 0.0, atol=1e-6)


def assert_consistent(trajectory: JointTrajectory) -> None:
    """Positions are the integral of the velocities, to the accuracy of the trapezoidal rule at 5 ms."""
    t, dq = trajectory.times_s, trajectory.dq_rad_s
    steps = np.diff(trajectory.q_rad, axis=0)
    rule = np.diff(t)[:, None] * (dq[1:] + dq[:-1]) / 2
    np.testing.assert_allclose(steps, rule, atol=2e-4)


@pytest.mark.parametrize("seed", range(20))
def test_any_joint_move_keeps_all_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad, (2, 7))
    trajectory = joint_move(start, end, PANDA.limits)
    check_limits(trajectory, PANDA.limits)
    assert_at_rest_at_both_ends(trajectory)
    assert_consistent(trajectory)
    np.testing.assert_allclose(trajectory.q_rad[[0, -1]], [start, end], atol=1e-9)


def test_a_joint_move_is_a_straight_line_at_the_fastest_joint_s_limit() -> None:
    end = PANDA.home_q_rad + np.array([1.5, 0.3, -0.2, 0.4, 0.1, -0.2, 0.5])
    trajectory = joint_move(PANDA.home_q_rad, end, PANDA.limits)
    share = (trajectory.q_rad - PANDA.home_q_rad) / (end - PANDA.home_q_rad)
    np.testing.assert_allclose(share, share[:, :1].repeat(7, axis=1), atol=1e-6)
    fastest = np.max(np.abs(trajectory.dq_rad_s) / PANDA.limits.velocity_rad_s)
    assert 0.95 < fastest <= 1.0


def test_a_joint_move_outside_a_limit_is_refused_by_name() -> None:
    with pytest.raises(SkillFailure, match="joint 4") as failure:
        joint_move(PANDA.home_q_rad, PANDA.home_q_rad + np.array([0, 0, 0, 3.0, 0, 0, 0]), PANDA.limits)
    assert failure.value.reason == "joint_limit"


def test_a_move_to_the_present_pose_stays_there() -> None:
    for trajectory in (
        joint_move(PANDA.home_q_rad, PANDA.home_q_rad, PANDA.limits),
        tool_move(KINEMATICS, PANDA.home_q_rad, (KINEMATICS.forward(PANDA.home_q_rad),), PROFILE),
        tool_move(KINEMATICS, PANDA.home_q_rad, (), PROFILE),
    ):
        check_trajectory(trajectory)
        np.testing.assert_array_equal(trajectory.q_rad[0], trajectory.q_rad[-1])


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(
    "profile",
    [
        PROFILE,
        VelocityProfile(speed_m_s=2.0, acceleration_m_s2=8.0, jerk_m_s3=80.0),
        VelocityProfile(speed_m_s=3.0, acceleration_m_s2=60.0, jerk_m_s3=1e5),
    ],
    ids=["as carried", "faster than the joints can", "as hard as can be"],
)
def test_any_carry_keeps_all_limits_and_ends_at_its_last_pose(seed: int, profile: VelocityProfile) -> None:
    rng = np.random.default_rng(seed)

    def grasp() -> Pose:
        return downward([rng.uniform(0.33, 0.68), rng.uniform(-0.3, 0.3), 0.011], rng.uniform(-0.7, 0.7))

    q = KINEMATICS.inverse(grasp(), yaw=Yaw.EITHER)
    end = grasp()
    path = (raised(KINEMATICS.forward(q), 0.05), raised(end, 0.05), end)
    trajectory = tool_move(KINEMATICS, q, path, profile)
    check_trajectory(trajectory)
    assert_at_rest_at_both_ends(trajectory)
    assert_consistent(trajectory)
    reached = matrix(KINEMATICS.forward(trajectory.q_rad[-1]))
    assert min(np.abs(reached - matrix(T)).max() for T in (end, half_turned(end))) < 1e-6
    track = tool_track(trajectory)
    speed = np.linalg.norm(np.diff(track, axis=0), axis=1) / np.diff(trajectory.times_s)
    assert speed.max() < 1.01 * profile.speed_m_s  # the path between samples is a spline, good to a thousandth
    assert track[:, 2].min() > 0.011 - 1e-4


@pytest.mark.parametrize(("leg_m", "turn_rad"), [(0.01, 0.3), (0.02, 0.6)])
def test_a_zigzag_of_short_legs_keeps_all_limits(leg_m: float, turn_rad: float) -> None:
    # A low jerk smooths over many corners at once: high speeds shift to corners.
    profile = VelocityProfile(speed_m_s=3.0, acceleration_m_s2=6.0, jerk_m_s3=60.0)
    rng = np.random.default_rng(0)
    for _ in range(25):
        place, yaw = np.array([rng.uniform(0.35, 0.65), rng.uniform(-0.2, 0.2), 0.2]), 0.0
        q = KINEMATICS.inverse(downward(place, yaw))
        path: list[Pose] = []
        for _ in range(6):
            place = place + np.array([*rng.uniform(-leg_m, leg_m, 2), 0.0])
            yaw += rng.uniform(-turn_rad, turn_rad)
            path.append(downward(place, yaw))
        check_trajectory(tool_move(KINEMATICS, q, tuple(path), profile))


def test_a_line_is_straight_and_reaches_the_requested_speed() -> None:
    q = KINEMATICS.inverse(downward([0.4, -0.25, 0.1], 0.2))
    trajectory = tool_move(KINEMATICS, q, (downward([0.5, 0.3, 0.1], 0.6),), PROFILE)
    track = tool_track(trajectory)
    direction = (track[-1] - track[0]) / np.linalg.norm(track[-1] - track[0])
    off = track - track[0] - np.outer((track - track[0]) @ direction, direction)
    assert np.linalg.norm(off, axis=1).max() < 1e-4  # inverse kinematics every 5 mm, a spline between
    speed = np.linalg.norm(np.diff(track, axis=0), axis=1) / np.diff(trajectory.times_s)
    assert speed.max() == pytest.approx(PROFILE.speed_m_s, rel=0.01)


def test_a_corner_is_rounded_without_a_stop() -> None:
    start, corner, end = (downward(p, 0.0) for p in ([0.45, -0.2, 0.1], [0.45, 0.0, 0.1], [0.6, 0.0, 0.1]))
    trajectory = tool_move(KINEMATICS, KINEMATICS.inverse(start), (corner, end), PROFILE)
    track = tool_track(trajectory)
    nearest = np.linalg.norm(track - corner.position_m, axis=1).min()
    assert 0.005 < nearest < 0.05
    speed = np.linalg.norm(np.diff(track, axis=0), axis=1) / np.diff(trajectory.times_s)
    inner = speed[len(speed) // 5 : -len(speed) // 5]
    assert inner.min() > 0.1


def test_a_fast_corner_is_taken_no_harder_than_the_profile_s_acceleration() -> None:
    start, corner, end = (downward(p, 0.0) for p in ([0.45, -0.3, 0.1], [0.45, 0.0, 0.1], [0.68, 0.0, 0.1]))
    profile = VelocityProfile(speed_m_s=0.6, acceleration_m_s2=1.0, jerk_m_s3=20.0)
    trajectory = tool_move(KINEMATICS, KINEMATICS.inverse(start), (corner, end), profile)
    dt = trajectory.times_s[1]
    acceleration = np.linalg.norm(np.diff(tool_track(trajectory), n=2, axis=0), axis=1) / dt**2
    # Along the path and across it together: at most the square root of two, and a tenth for the spline.
    assert acceleration.max() < 1.1 * np.sqrt(2.0) * profile.acceleration_m_s2


def test_a_path_turned_by_half_a_turn_is_followed_without_turning() -> None:
    q = KINEMATICS.inverse(downward([0.5, 0.0, 0.1], 0.0))
    trajectory = tool_move(KINEMATICS, q, (downward([0.5, 0.1, 0.1], np.pi),), PROFILE)
    assert np.max(np.abs(trajectory.q_rad[:, 6] - q[6])) < 0.3  # the base turns by 0.2 rad, no more is needed


def test_a_path_stops_where_it_reverses() -> None:
    low, high = downward([0.5, 0.0, 0.05], 0.0), downward([0.5, 0.0, 0.2], 0.0)
    trajectory = tool_move(KINEMATICS, KINEMATICS.inverse(high), (low, high), PROFILE)
    track = tool_track(trajectory)
    assert track[:, 2].min() == pytest.approx(0.05, abs=1e-5)
    turn = int(np.argmin(track[:, 2]))
    np.testing.assert_allclose(trajectory.dq_rad_s[turn], 0.0, atol=1e-6)
    check_trajectory(trajectory)


def test_poses_on_a_straight_leg_cost_no_time() -> None:
    q = KINEMATICS.inverse(downward([0.45, -0.2, 0.05], 0.0))
    places = np.linspace([0.45, -0.2, 0.1], [0.45, 0.2, 0.1], 40)
    many = tool_move(KINEMATICS, q, tuple(downward(p, 0.02 * i) for i, p in enumerate(places)), PROFILE)
    two = tool_move(KINEMATICS, q, (downward(places[0], 0.0), downward(places[-1], 0.78)), PROFILE)
    assert many.times_s[-1] == pytest.approx(two.times_s[-1], rel=0.01)


def test_turning_on_the_spot_takes_time_and_keeps_the_limits() -> None:
    q = KINEMATICS.inverse(downward([0.5, 0.0, 0.1], 0.0))
    trajectory = tool_move(KINEMATICS, q, (downward([0.5, 0.0, 0.1], 1.2),), PROFILE)
    check_trajectory(trajectory)
    assert trajectory.times_s[-1] > 1.2 / PANDA.limits.velocity_rad_s[6]
    np.testing.assert_allclose(tool_track(trajectory), [[0.5, 0.0, 0.1]] * len(trajectory.times_s), atol=1e-5)


def test_a_path_out_of_reach_is_refused_by_name() -> None:
    q = KINEMATICS.inverse(downward([0.5, 0.0, 0.1], 0.0))
    with pytest.raises(SkillFailure) as failure:
        tool_move(KINEMATICS, q, (downward([0.9, 0.0, 0.1], 0.0),), PROFILE)
    assert failure.value.reason == "unreachable"
