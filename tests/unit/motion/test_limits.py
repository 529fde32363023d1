"""A trajectory is checked by the differences of its angles."""

import msgspec
import numpy as np
import pytest

from dlokit.description.arm.franka import FR3, PANDA
from dlokit.errors import SkillFailure
from dlokit.geometry import pose
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import (
    check_limits,
    executed_range,
    executed_speeds,
    scaled,
    slowdown,
    speed_ratio,
)
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, JointTrajectory, RobotReason

GOOD = joint_move(PANDA.home_q_rad, PANDA.home_q_rad + np.array([1.0, 0.2, 0.1, 0.3, 0.1, -0.2, 0.5]), PANDA.limits)


def failure_of(trajectory: JointTrajectory, limits: JointLimits = PANDA.limits) -> SkillFailure | None:
    try:
        check_limits(trajectory, limits)
    except SkillFailure as failure:
        return failure
    return None


def reason_of(trajectory: JointTrajectory) -> str:
    failure = failure_of(trajectory)
    return failure.reason if failure else ""


def trajectory(times: Float64Array, q: Float64Array, dq: Float64Array, ddq: Float64Array) -> JointTrajectory:
    """A motion of the second joint from home, (K,) each; the others are at rest."""
    rows = [np.zeros((len(times), 7)) for _ in range(3)]
    for row, values in zip(rows, (q, dq, ddq), strict=True):
        row[:, 1] = values
    return JointTrajectory(times_s=times, q_rad=rows[0] + PANDA.home_q_rad, dq_rad_s=rows[1], ddq_rad_s2=rows[2])


def test_a_jump_of_the_angles_that_the_velocities_conceal_is_refused() -> None:
    nothing = np.zeros(2)
    assert (
        reason_of(trajectory(np.array([0.0, 0.005]), np.array([0.0, 0.08]), nothing, nothing))
        == RobotReason.VELOCITY_LIMIT
    )
    assert (
        reason_of(trajectory(np.array([0.0, 0.005]), np.array([0.0, 1.0]), nothing, nothing))
        == RobotReason.VELOCITY_LIMIT
    )


def test_a_trajectory_that_states_no_velocity_at_all_is_refused() -> None:
    still = msgspec.structs.replace(GOOD, dq_rad_s=np.zeros_like(GOOD.q_rad), ddq_rad_s2=np.zeros_like(GOOD.q_rad))
    assert reason_of(still)


def test_oscillating_velocities_with_constant_angles_are_refused() -> None:
    # Between samples, the arm would oscillate by 2 rad/s * 5 ms / 4, whatever accelerations are stated.
    times = 0.005 * np.arange(101, dtype=np.float64)
    swing = 0.3 * np.cos(np.pi * np.arange(101, dtype=np.float64))
    swing[[0, -1]] = 0.0
    nothing = np.zeros(101)
    assert reason_of(trajectory(times, nothing, swing, nothing)) == RobotReason.ACCELERATION_LIMIT


def test_accelerations_that_do_not_match_the_velocities_are_refused() -> None:
    assert (
        reason_of(msgspec.structs.replace(GOOD, ddq_rad_s2=np.zeros_like(GOOD.ddq_rad_s2)))
        == RobotReason.BAD_TRAJECTORY
    )


@pytest.mark.parametrize("name", ["times_s", "q_rad", "dq_rad_s", "ddq_rad_s2"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_every_array_must_be_finite(name: str, value: float) -> None:
    spoilt = getattr(GOOD, name).copy()
    spoilt.reshape(len(spoilt), -1)[len(spoilt) // 2, -1] = value
    found = failure_of(msgspec.structs.replace(GOOD, **{name: spoilt}))
    assert found is not None
    assert found.reason == RobotReason.BAD_TRAJECTORY
    assert name in found.detail


def test_a_start_or_an_end_in_motion_is_refused() -> None:
    half = len(GOOD.times_s) // 2
    for rows in (slice(0, half), slice(half, None)):
        part = JointTrajectory(
            times_s=GOOD.times_s[rows] - GOOD.times_s[rows][0],
            q_rad=GOOD.q_rad[rows],
            dq_rad_s=GOOD.dq_rad_s[rows],
            ddq_rad_s2=GOOD.ddq_rad_s2[rows],
        )
        assert reason_of(part) == RobotReason.BAD_TRAJECTORY


def test_an_arm_of_other_joints_and_samples_too_far_apart_or_too_near_are_refused() -> None:
    assert reason_of(msgspec.structs.replace(GOOD, **{n: getattr(GOOD, n)[:, :6] for n in GOOD.__struct_fields__[1:]}))
    thin = slice(0, None, len(GOOD.times_s) - 1)
    nothing = np.zeros((2, 7))
    ends = JointTrajectory(times_s=np.array([0.0, 60.0]), q_rad=GOOD.q_rad[thin], dq_rad_s=nothing, ddq_rad_s2=nothing)
    assert reason_of(ends) == RobotReason.BAD_TRAJECTORY
    assert reason_of(trajectory(np.array([0.0, 1e-5]), *np.zeros((3, 2)))) == RobotReason.BAD_TRAJECTORY


@pytest.mark.parametrize("last_s", [200.1, 1e308])
def test_a_trajectory_that_is_too_long_is_refused(last_s: float) -> None:
    q = np.array([0.0, 0.0])
    assert reason_of(trajectory(np.array([0.0, last_s]), q, 0.0 * q, 0.0 * q)) == RobotReason.TOO_SLOW


def test_a_range_that_is_exceeded_only_between_samples_is_detected() -> None:
    times, rows = 0.05 * np.arange(3, dtype=np.float64), np.tile(PANDA.home_q_rad, (3, 1))
    rows[:, 3] = PANDA.limits.position_upper_rad[3] - 1e-4
    dq = np.zeros((3, 7))
    dq[1, 3] = 0.1
    over = JointTrajectory(times_s=times, q_rad=rows, dq_rad_s=dq, ddq_rad_s2=np.zeros((3, 7)))
    assert executed_range(over)[1].max(axis=0)[3] > PANDA.limits.position_upper_rad[3]
    assert reason_of(over) == RobotReason.JOINT_LIMIT


def test_extremes_between_samples_are_those_of_a_dense_search() -> None:
    rng = np.random.default_rng(0)
    times, (q, dq) = np.array([0.0, 0.2, 0.25]), rng.normal(size=(2, 3, 50))
    given = JointTrajectory(times_s=times, q_rad=q, dq_rad_s=dq, ddq_rad_s2=np.zeros((3, 50)))
    lowest, highest = executed_range(given)
    ((fastest, _),) = executed_speeds(given, PANDA.limits)
    u = np.linspace(0.0, 1.0, 2001)[:, None]
    for i, h in enumerate(np.diff(times)):
        q0, q1, v0, v1 = q[i], q[i + 1], h * dq[i], h * dq[i + 1]
        between = q0 + u * (v0 + u * (3 * (q1 - q0) - 2 * v0 - v1 + u * (v0 + v1 - 2 * (q1 - q0))))
        velocity = np.gradient(between, h / 2000, axis=0, edge_order=2)
        np.testing.assert_allclose(lowest[i], between.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(highest[i], between.max(axis=0), atol=1e-5)
        np.testing.assert_allclose(fastest[i], np.abs(velocity).max(axis=0), rtol=1e-4)


@pytest.mark.parametrize("sample_s", [0.0005, 0.002, 0.005, 0.01])
def test_a_motion_at_its_limits_passes_at_any_sampling_rate(sample_s: float) -> None:
    # Jerk and acceleration alternately at the limit, velocity 2 % below it; at any sampling phase.
    jerk, top = PANDA.limits.jerk_rad_s3[1], PANDA.limits.acceleration_rad_s2[1]
    ramp_s = top / jerk
    hold_s = 0.98 * PANDA.limits.velocity_rad_s[1] / top - ramp_s
    legs = [(jerk, ramp_s), (0.0, hold_s), (-jerk, ramp_s), (0.0, 0.1)]
    legs += [(-jerk, ramp_s), (0.0, hold_s), (jerk, ramp_s)]
    times = np.arange(0.0, sum(leg[1] for leg in legs) + 3 * sample_s, sample_s)
    for shift in np.linspace(0.0, 0.9 * sample_s, 7):
        rows = np.array([_at(legs, t - shift) for t in times])
        check_limits(trajectory(times, *rows.T), PANDA.limits)


def _at(legs: list[tuple[float, float]], t: float) -> tuple[float, float, float]:
    q = v = a = 0.0
    for jerk, duration in legs:
        s = min(max(t, 0.0), duration)
        q, v, a = q + s * (v + s * (a / 2 + s * jerk / 6)), v + s * (a + s * jerk / 2), a + s * jerk
        t -= duration
    return q, v, a


def test_a_slower_pace_keeps_the_limits_and_the_path() -> None:
    assert scaled(GOOD, 1.0) is GOOD
    slow = scaled(GOOD, 0.05)
    assert reason_of(slow) == ""
    np.testing.assert_array_equal(slow.q_rad, GOOD.q_rad)
    assert slow.times_s[-1] == pytest.approx(20.0 * GOOD.times_s[-1])
    fast = scaled(GOOD, 2.0)
    assert reason_of(scaled(fast, 0.999 / slowdown(fast, PANDA.limits))) == ""


def test_the_speed_ratio_is_one_at_the_limit_of_the_joint_where_it_is() -> None:
    end = FR3.home_q_rad + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    fast = joint_move(FR3.home_q_rad, end, FR3.limits)
    ratio = speed_ratio(fast, FR3.limits)
    assert 0.95 < ratio <= 1.0
    assert speed_ratio(scaled(fast, 0.5), FR3.limits) == pytest.approx(ratio / 2)
    # Near the end of its range the joint may only move slowly: the same speed is nearer to its limit there.
    slow = scaled(joint_move(end, end + np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), FR3.limits), 0.5)
    everywhere = msgspec.structs.replace(FR3.limits, slow_near=None)
    assert speed_ratio(slow, FR3.limits) > 1.1 * speed_ratio(slow, everywhere)


@pytest.mark.parametrize("seed", [4341, 1727, 1262, 4275])
def test_a_zigzag_of_short_legs_keeps_the_limits_by_its_differences(seed: int) -> None:
    # The worst of 6,500: their sampled velocities exceeded an acceleration limit by 3 to 13 %.
    kinematics, rng = ArmKinematics(PANDA), np.random.default_rng(seed)
    q = kinematics.inverse(pose([rng.uniform(0.35, 0.65), rng.uniform(-0.2, 0.2), 0.2], [0.0, 1.0, 0.0, 0.0]))
    T = kinematics.forward(q)
    leg = 10 ** rng.uniform(-3.0, -1.5)
    places = T.position_m + np.cumsum(np.column_stack([rng.uniform(-leg, leg, (6, 2)), np.zeros(6)]), axis=0)
    profile = VelocityProfile(
        speed_m_s=3.0, acceleration_m_s2=10 ** rng.uniform(1, 2), jerk_m_s3=10 ** rng.uniform(2, 4.5)
    )
    assert reason_of(tool_move(kinematics, q, tuple(pose(p, T.wxyz) for p in places), profile)) == ""


def test_a_jump_in_acceleration_is_a_jerk() -> None:
    times = 0.05 * np.arange(41, dtype=np.float64)
    v = np.clip(1.0 - np.abs(times - 1.0), 0.0, None)
    q = np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.05)))
    a = np.where(times < 1.0, 1.0, -1.0)
    low = msgspec.structs.replace(PANDA.limits, jerk_rad_s3=np.full(7, 10.0))
    found = failure_of(trajectory(times, q, v, a), low)
    assert found is not None
    assert found.reason == RobotReason.JERK_LIMIT
