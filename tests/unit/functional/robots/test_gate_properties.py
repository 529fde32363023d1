"""Whatever reaches the gate: what it lets through keeps the limits as the cell runs it, and honest motions pass."""

import asyncio
import contextlib
import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from robot_bench import KINEMATICS, PerfectArm

from dlokit.communication import virtual_time
from dlokit.description.panda_data import PANDA_HOME_Q_RAD, PANDA_LIMITS
from dlokit.description.panda_kinematics import tcp_matrices
from dlokit.errors import BadValue, SkillFailure
from dlokit.functional.cell.setpoints import Follow
from dlokit.functional.robots.gate import GatedRobot
from dlokit.functional.robots.gate_config import GateConfig
from dlokit.geometry import downward
from dlokit.motion.limits import scaled
from dlokit.skills.robot.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory, Lease

LEASE = Lease(holder="test")
CONFIG = GateConfig()
# The same inputs in every run; no files of examples beside the tests.
QUICK = settings(
    max_examples=150, deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)

PARTS = ("times_s", "q_rad", "dq_rad_s", "ddq_rad_s2")
seeds = st.integers(0, 2**32 - 1)
poison = st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 0.0, 1.0, -3.0])


def passes(trajectory: JointTrajectory, config: GateConfig = CONFIG) -> JointTrajectory | None:
    """What the arm is given of a trajectory that starts where it stands, if anything."""

    async def main() -> JointTrajectory | None:
        arm = PerfectArm()
        arm.q = np.clip(trajectory.q_rad[0], PANDA_LIMITS.position_lower_rad, PANDA_LIMITS.position_upper_rad)
        robot = GatedRobot(arm, config, lambda: round(asyncio.get_running_loop().time() * 1e9))
        with contextlib.suppress(SkillFailure):
            await robot.follow(trajectory, LEASE)
        return arm.followed[0] if arm.followed else None

    return virtual_time.run(main())


def assert_executed_within_limits(trajectory: JointTrajectory) -> None:
    """Hold what the cell's own set-points do, ten to a sample, to the limits and to the gate's box and speed."""
    program, times = Follow(trajectory, 0.0), trajectory.times_s
    fine = np.unique(np.concatenate([np.linspace(a, b, 11) for a, b in itertools.pairwise(times)]))
    q = np.array([program.at(float(t)).q_rad for t in fine])
    assert np.all(q >= PANDA_LIMITS.position_lower_rad - 1e-6)
    assert np.all(q <= PANDA_LIMITS.position_upper_rad + 1e-6)
    assert np.all(np.abs(_slopes(fine, q)) <= PANDA_LIMITS.velocity_rad_s * (1 + 1e-5))
    sampled = _curvatures(times, trajectory.q_rad)
    assert np.all(np.abs(sampled) <= PANDA_LIMITS.acceleration_rad_s2 * (1 + 1e-4))
    # A cubic piece through samples of a motion needs up to 5/3 of the motion's acceleration between them.
    between = _curvatures(fine, q)
    assert np.all(np.abs(between) <= 5.0 / 3.0 * PANDA_LIMITS.acceleration_rad_s2 * (1 + 1e-4) + 1e-2)
    places = tcp_matrices(trajectory.q_rad)[:, :3, 3]
    assert np.all((places >= CONFIG.workspace_lower_m) & (places <= CONFIG.workspace_upper_m))
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert speeds.max() <= CONFIG.largest_tool_speed_m_s


def _slopes(times: Float64Array, q: Float64Array) -> Float64Array:
    return np.diff(q, axis=0) / np.diff(times)[:, None]


def _curvatures(times: Float64Array, q: Float64Array) -> Float64Array:
    return 2.0 * np.diff(_slopes(times, q), axis=0) / (times[2:] - times[:-2])[:, None]


def honest(seed: int) -> JointTrajectory:
    """A planned motion over the table, of one of the kinds that skills plan."""
    rng = np.random.default_rng(seed)

    def angles() -> Float64Array:
        place = [rng.uniform(0.35, 0.65), rng.uniform(-0.3, 0.3), rng.uniform(0.011, 0.4)]
        return KINEMATICS.inverse(downward(place, rng.uniform(-0.7, 0.7)))

    start = angles()
    kind = rng.integers(4)
    if kind == 0:
        return joint_move(start, angles())
    if kind == 1:
        return joint_move(start, start + rng.normal(size=7) * 10 ** rng.uniform(-6.0, -2.0))
    poses = tuple(KINEMATICS.forward(angles()) for _ in range(kind - 1))
    return tool_move(KINEMATICS, start, poses, VelocityProfile(speed_m_s=10 ** rng.uniform(-1.5, 0.3)))


@settings(QUICK, max_examples=60)
@given(seed=seeds)
def test_honest_motions_pass_and_keep_the_limits_as_they_are_run(seed: int) -> None:
    try:
        planned = honest(seed)
    except SkillFailure:
        assume(False)
        raise
    run = passes(planned)
    assert run is not None
    assert run is planned
    assert_executed_within_limits(run)


@QUICK
@given(
    seed=seeds,
    part=st.sampled_from(PARTS),
    value=poison,
    places=st.lists(st.integers(0, 10**6), min_size=1, max_size=3),
)
def test_a_value_put_into_a_motion_never_leads_to_a_motion_that_breaks_a_limit(
    seed: int, part: str, value: float, places: list[int]
) -> None:
    spoilt = getattr(GOOD[seed % len(GOOD)], part).copy()
    spoilt.reshape(-1)[[place % spoilt.size for place in places]] = value
    given_ = msgspec.structs.replace(GOOD[seed % len(GOOD)], **{part: spoilt})
    with np.errstate(all="ignore"):
        run = passes(given_)
    if not np.isfinite(spoilt).all():
        assert run is None
    if run is not None:
        assert_executed_within_limits(run)


GOOD = [joint_move(PANDA_HOME_Q_RAD, PANDA_HOME_Q_RAD + shift) for shift in (0.05, -0.2)]


@QUICK
@given(
    seed=seeds,
    part=st.sampled_from(PARTS),
    size=st.floats(1e-6, 3.0),
    how=st.sampled_from(["factor", "noise", "shift", "step", "zero", "pace"]),
)
def test_a_motion_whose_parts_disagree_is_refused_or_keeps_the_limits(
    seed: int, part: str, size: float, how: str
) -> None:
    rng = np.random.default_rng(seed)
    base = GOOD[seed % len(GOOD)]
    values = getattr(base, part)
    half = (np.arange(len(values)) > len(values) // 2).reshape(-1, *(1,) * (values.ndim - 1))
    changed = {
        "factor": values * (1.0 + size),
        "noise": values + size * rng.normal(size=values.shape),
        "shift": values + size,
        "step": values + size * half,
        "zero": np.zeros_like(values),
        "pace": values,
    }[how]
    altered = scaled(base, 1.0 + size) if how == "pace" else msgspec.structs.replace(base, **{part: changed})
    run = passes(altered)
    if run is not None:
        assert_executed_within_limits(run)


@QUICK
@given(seed=seeds, samples=st.integers(1, 12), log_step=st.floats(-6.0, 2.0), log_size=st.floats(-9.0, 2.0))
def test_random_numbers_are_refused_or_keep_the_limits(
    seed: int, samples: int, log_step: float, log_size: float
) -> None:
    rng = np.random.default_rng(seed)
    q, dq, ddq = 10**log_size * rng.normal(size=(3, samples, 7)) * np.array([1.0, 10.0, 100.0])[:, None, None]
    q -= q[:1]
    times = np.concatenate(([0.0], np.cumsum(10**log_step * rng.uniform(0.1, 1.0, samples - 1))))
    run = passes(JointTrajectory(times_s=times, q_rad=PANDA_HOME_Q_RAD + q, dq_rad_s=dq, ddq_rad_s2=ddq))
    if run is not None:
        assert_executed_within_limits(run)


@pytest.mark.parametrize("part", PARTS[1:])
@pytest.mark.parametrize("shape", [(3, 7), (2, 6), (2, 8), (14,), (2, 7, 1), (0, 7), (2, 0)])
def test_wrong_lengths_are_no_trajectory(part: str, shape: tuple[int, ...]) -> None:
    fine = {name: np.zeros((2, 7)) for name in PARTS[1:]}
    with pytest.raises(BadValue):
        JointTrajectory(times_s=np.array([0.0, 0.005]), **{**fine, part: np.zeros(shape)})
