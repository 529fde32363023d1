"""For any input, the motions that the gate passes keep the limits in the cell, and valid motions pass."""

import asyncio
import contextlib

import msgspec
import numpy as np
import pytest
from adversarial import DISAGREEMENTS, MUTATIONS, PARTS, POISON, disagreeing, executed_breach, honest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from robot_bench import PerfectArm

from dlokit.communication.timing import virtual_time
from dlokit.description.arm.franka import PANDA
from dlokit.errors import BadValue, CommunicationError, SkillFailure
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.motion.trajectories import joint_move
from dlokit.types.robot import JointTrajectory, Lease

LEASE = Lease(holder="test")
CONFIG = GateConfig()
# The same inputs in every run; no files of examples beside the tests.
QUICK = settings(
    max_examples=150, deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)

seeds = st.integers(0, 2**32 - 1)
poison = st.sampled_from(POISON)


def passes(trajectory: JointTrajectory, config: GateConfig = CONFIG) -> JointTrajectory | None:
    """The trajectory that the gate passes to the arm, if any, for one that starts at the arm's state."""

    async def main() -> JointTrajectory | None:
        arm = PerfectArm()
        if trajectory.q_rad.shape[1] == 7:
            arm.q = np.clip(trajectory.q_rad[0], PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad)
        robot = GatedRobot(arm, config, lambda: round(asyncio.get_running_loop().time() * 1e9))
        with contextlib.suppress(SkillFailure):
            await robot.follow(trajectory, LEASE)
        return arm.followed[0] if arm.followed else None

    return virtual_time.run(main())


def assert_executed_within_limits(trajectory: JointTrajectory) -> None:
    """Check the cell's own set-points, ten per sample, against the limits and the gate's box and speed."""
    assert executed_breach(trajectory, CONFIG) == ""


@pytest.mark.heavy
@settings(QUICK, max_examples=60)
@given(seed=seeds)
def test_valid_motions_pass_and_keep_the_limits_in_the_cell(seed: int) -> None:
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
def test_a_modified_value_never_leads_to_a_motion_that_exceeds_a_limit(
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


GOOD = [joint_move(PANDA.home_q_rad, PANDA.home_q_rad + shift, PANDA.limits) for shift in (0.05, -0.2)]


@QUICK
@given(
    seed=seeds,
    part=st.sampled_from(PARTS),
    size=st.floats(1e-6, 3.0),
    how=st.sampled_from(DISAGREEMENTS),
)
def test_a_motion_with_inconsistent_arrays_is_refused_or_keeps_the_limits(
    seed: int, part: str, size: float, how: str
) -> None:
    altered = disagreeing(GOOD[seed % len(GOOD)], np.random.default_rng(seed), part, size, how)
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
    run = passes(JointTrajectory(times_s=times, q_rad=PANDA.home_q_rad + q, dq_rad_s=dq, ddq_rad_s2=ddq))
    if run is not None:
        assert_executed_within_limits(run)


@settings(QUICK, max_examples=400)
@given(seed=seeds, kind=st.sampled_from(sorted(MUTATIONS)))
def test_every_kind_of_adversarial_motion_is_refused_or_keeps_the_limits(seed: int, kind: str) -> None:
    with np.errstate(all="ignore"):
        try:
            made = MUTATIONS[kind](GOOD[seed % len(GOOD)], np.random.default_rng(seed))
        except (BadValue, CommunicationError):
            return
        run = passes(made)
    if run is not None:
        assert_executed_within_limits(run)


@pytest.mark.parametrize("part", PARTS[1:])
@pytest.mark.parametrize("shape", [(3, 7), (2, 6), (2, 8), (14,), (2, 7, 1), (0, 7), (2, 0)])
def test_arrays_of_unequal_lengths_are_refused(part: str, shape: tuple[int, ...]) -> None:
    fine = {name: np.zeros((2, 7)) for name in PARTS[1:]}
    with pytest.raises(BadValue):
        JointTrajectory(times_s=np.array([0.0, 0.005]), **{**fine, part: np.zeros(shape)})
