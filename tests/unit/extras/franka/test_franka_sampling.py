"""Set-points of the Franka: on the trajectory, and in braking still on its path, within the joints' limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dlokit.description.arm.franka import FR3
from dlokit.extras.franka.sampling import Course
from dlokit.geometry import downward
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory

CYCLE_S = 1e-3
LIMITS = FR3.limits
KINEMATICS = ArmKinematics(FR3)
ALLOWED = 1.2
"""Factor on the acceleration limits: the Hermite pieces of a planned motion exceed them between its samples."""


def course(trajectory: JointTrajectory, start: Float64Array | None = None) -> Course:
    return Course(
        trajectory.times_s,
        trajectory.q_rad,
        trajectory.dq_rad_s,
        trajectory.q_rad[0] if start is None else start,
        LIMITS.velocity_rad_s,
        LIMITS.acceleration_rad_s2,
        LIMITS.jerk_rad_s3,
    )


def move(seed: int) -> JointTrajectory:
    """A joint motion, or a tool path with a corner, chosen by a seed."""
    random = np.random.default_rng(seed)
    if seed % 2:
        away = FR3.home_q_rad + random.uniform(-1.0, 1.0, 7) * np.array([1.0, 0.6, 0.8, 0.5, 1.2, 0.8, 1.5])
        return joint_move(FR3.home_q_rad, np.clip(away, LIMITS.position_lower_rad, LIMITS.position_upper_rad), LIMITS)
    start = KINEMATICS.inverse(downward([0.45, 0.0, 0.15], 0.3))
    corners = [downward([*random.uniform((0.35, -0.25), (0.6, 0.25)), 0.15], 0.3) for _ in range(2)]
    return tool_move(KINEMATICS, start, tuple(corners), VelocityProfile(speed_m_s=1.0, acceleration_m_s2=5.0))


def nearest_distance_rad(q: Float64Array, trajectory: JointTrajectory) -> float:
    """Distance of angles from the trajectory's path, by its finely interpolated samples."""
    fine = course(trajectory)
    points = [fine.setpoint()[0]]
    while not fine.finished:
        fine.advance(CYCLE_S)
        points.append(fine.setpoint()[0])
    return float(np.min(np.max(np.abs(np.array(points) - q), axis=1)))


def test_at_the_samples_it_is_the_trajectory_and_between_them_position_and_velocity_agree() -> None:
    trajectory = move(1)
    under_way = course(trajectory)
    for index in range(1, len(trajectory.times_s) - 1, 7):
        under_way.advance(float(trajectory.times_s[index]) - under_way.path_s)
        q, dq = under_way.setpoint()
        np.testing.assert_allclose(q, trajectory.q_rad[index], atol=1e-9)
        np.testing.assert_allclose(dq, trajectory.dq_rad_s[index], atol=1e-7)
        later, _ = under_way.setpoint(ahead_s=1e-6)
        np.testing.assert_allclose((later - q) / 1e-6, dq, atol=1e-3)


def test_it_ends_at_rest_at_the_last_sample_however_the_arms_clock_jumps() -> None:
    trajectory = move(3)
    under_way = course(trajectory)
    for step_s in np.random.default_rng(0).uniform(0.0, 0.09, 200):
        under_way.advance(float(step_s))
    assert under_way.finished
    q, dq = under_way.setpoint(ahead_s=0.002)
    np.testing.assert_array_equal(q, trajectory.q_rad[-1])
    np.testing.assert_array_equal(dq, np.zeros(7))


@pytest.mark.heavy
@given(seed=st.integers(0, 40), fraction=st.floats(0.02, 0.98), pace=st.sampled_from((0.1, 0.3, 1.0)))
@settings(max_examples=40, deadline=None)
def test_braking_stays_on_the_path_within_the_limits_and_ends_within_the_joints_braking_time(
    seed: int, fraction: float, pace: float
) -> None:
    trajectory = scaled(move(seed), pace)
    under_way = course(trajectory)
    under_way.advance(fraction * float(trajectory.times_s[-1]))
    _, dq = under_way.setpoint()
    braking_s = float(np.max(np.abs(dq) / LIMITS.acceleration_rad_s2))
    began_s = under_way.path_s
    under_way.brake()
    q_before, dq_before = under_way.setpoint()
    cycles = 0
    while not under_way.finished:
        under_way.advance(CYCLE_S)
        cycles += 1
        q, dq = under_way.setpoint()
        acceleration = np.abs(dq - dq_before) / CYCLE_S
        assert np.all(acceleration <= ALLOWED * LIMITS.acceleration_rad_s2 + 0.2), (cycles, acceleration)
        np.testing.assert_allclose(q - q_before, 0.5 * (dq + dq_before) * CYCLE_S, atol=2e-5)
        q_before, dq_before = q, dq
    assert cycles * CYCLE_S <= braking_s + 0.2
    assert began_s <= under_way.path_s <= float(trajectory.times_s[-1])
    assert nearest_distance_rad(q_before, trajectory) < 5e-3
    np.testing.assert_array_equal(under_way.setpoint()[1], np.zeros(7))


def test_a_braked_course_stays_where_it_is() -> None:
    under_way = course(move(1))
    under_way.advance(0.2)
    under_way.brake()
    for _ in range(2000):
        under_way.advance(CYCLE_S)
    stands = under_way.setpoint()[0]
    under_way.advance(1.0)
    np.testing.assert_array_equal(under_way.setpoint()[0], stands)


def test_an_offset_at_the_start_fades_out_slowly() -> None:
    trajectory = move(1)
    start = trajectory.q_rad[0] + np.array([0.02, -0.02, 0.0, 0.01, 0.0, 0.0, 0.02])
    under_way = course(trajectory, start)
    np.testing.assert_allclose(under_way.setpoint()[0], start, atol=1e-12)
    plain = course(trajectory)
    largest = 0.0
    while not under_way.finished:
        under_way.advance(CYCLE_S)
        plain.advance(CYCLE_S)
        largest = max(largest, float(np.abs(under_way.setpoint()[1] - plain.setpoint()[1]).max()))
    assert largest <= 0.05 * float(LIMITS.velocity_rad_s.max()) + 1e-9
    np.testing.assert_allclose(under_way.setpoint()[0], trajectory.q_rad[-1], atol=1e-12)


@pytest.mark.parametrize("step_s", [0.0, 0.002, 0.05])
def test_braking_is_the_same_for_any_rate_of_set_points(step_s: float) -> None:
    fine, coarse = course(move(5)), course(move(5))
    for each in (fine, coarse):
        each.advance(0.3)
        each.brake()
    for _ in range(600):
        fine.advance(CYCLE_S)
    while not coarse.finished and step_s:
        coarse.advance(step_s)
    if step_s:
        assert coarse.path_s == pytest.approx(fine.path_s, abs=1e-4)
    else:
        coarse.advance(0.0)
        assert not coarse.finished
