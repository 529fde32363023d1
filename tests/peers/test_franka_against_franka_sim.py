"""The driver of the Franka against franka-sim, which enforces communication and motion limits: `make test-peers`.

Each test has the simulator, the driver's processes and the machine to itself, and prints the machine's load.
"""

import asyncio
import os
import re
import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from franka_sim_server import FrankaSimServer, why_not

from dlokit.app.commands import execute
from dlokit.description.arm.franka import FR3
from dlokit.errors import SkillFailure
from dlokit.extras.franka import limits
from dlokit.extras.franka.driver import FrankaRobot
from dlokit.functional.cell.arm import CellArm
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory, Lease, Remedy, RobotMode, remedy_of
from parts.franka_commander import AWAY_RAD, franka

pytestmark = [pytest.mark.peers, pytest.mark.skipif(bool(why_not()), reason=why_not() or "it can run")]

LEASE = Lease(holder="test", duration_s=0.2)
TRAJECTORIES = 20
TRIES = 4
"""How often a trajectory is tried that a busy machine ends in a communication reflex."""
COMMUNICATION = "communication_constraints_violation"
FREEZE_S = 0.06
"""Three times what franka-sim allows without set-points, and less than the guardian does."""


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FrankaSimServer]:
    with FrankaSimServer(tmp_path) as server:
        yield server


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> list[JointTrajectory]:
    """The motions of an FR3 in shaping tasks in lockstep, in their order."""
    executed = list[JointTrajectory]()
    follow = CellArm.start_follow

    def noted(arm: CellArm, trajectory: JointTrajectory, now_s: float) -> None:
        executed.append(trajectory)
        follow(arm, trajectory, now_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CellArm, "start_follow", noted)
        for seed in range(TRAJECTORIES):
            out = str(tmp_path_factory.mktemp("runs") / "run")
            run = ["--headless", "--no-record", "--start", "random", "--goal", "S", "--seed", str(seed), "--out", out]
            assert execute(["shape", "--arm", "fr3", *run]) == 0
            if len(executed) >= TRAJECTORIES:
                break
    return executed[:TRAJECTORIES]


def run_on(server: FrankaSimServer, folder: Path, scenario: Callable[[FrankaRobot], Awaitable[None]]) -> None:
    async def main() -> None:
        async with franka(server.address, folder) as robot:
            await scenario(robot)

    asyncio.run(main())


def _reflexes(server: FrankaSimServer) -> set[str]:
    """The errors by which the simulator itself has ended motions, from its log."""
    return set(re.findall(r"ERROR \S+: (\w+): .* -- aborting the motion", server.log()))


async def bring(robot: FrankaRobot, q_rad: Float64Array) -> None:
    """Bring the arm somewhere, slowly; a busy machine may need several tries."""
    for _ in range(TRIES):
        try:
            await robot.follow(scaled(joint_move(robot.state().q_rad, q_rad, FR3.limits), 0.2), LEASE)
        except SkillFailure as failure:
            if COMMUNICATION not in failure.detail:
                raise
            await robot.recover()
        else:
            return
    raise AssertionError("the machine is too busy for a slow motion")


@pytest.mark.parametrize("pace", [0.3, 1.0])
def test_the_motions_of_shaping_tasks_end_without_a_motion_reflex(
    pace: float,
    planned: list[JointTrajectory],
    server: FrankaSimServer,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert len(planned) == TRAJECTORIES
    errors_rad, communication = list[float](), 0

    async def scenario(robot: FrankaRobot) -> None:
        nonlocal communication
        for trajectory in planned:
            for _ in range(TRIES):
                if np.abs(robot.state().q_rad - trajectory.q_rad[0]).max() > 0.005:
                    await bring(robot, trajectory.q_rad[0])
                try:
                    result = await robot.follow(scaled(trajectory, pace), LEASE)
                except SkillFailure as failure:
                    if COMMUNICATION not in failure.detail:
                        raise
                    communication += 1
                    await robot.recover()
                else:
                    errors_rad.append(result.largest_joint_error_rad)
                    break

    run_on(server, tmp_path, scenario)
    with capsys.disabled():
        print(
            f"\npace {pace}: {len(errors_rad)} of {len(planned)} without a motion reflex, {communication} communication"
            f" reflexes; largest error {1e3 * max(errors_rad):.1f} mrad, median {1e3 * np.median(errors_rad):.1f}"
        )
    assert len(errors_rad) == TRAJECTORIES
    assert _reflexes(server) <= {COMMUNICATION}
    if pace <= 0.3:
        assert max(errors_rad) <= 0.02


def too_fast(q_rad: Float64Array) -> JointTrajectory:
    """Turns the base at 2.9 rad/s, which neither gate nor driver passes: its limit is 2.62."""
    return _turn(q_rad, 0, speed_rad_s=2.9, acceleration_rad_s2=10.0, angle_rad=1.5)


def too_strong(q_rad: Float64Array) -> JointTrajectory:
    """Needs more than the 12 N·m of the wrist."""
    return _turn(q_rad, 5, speed_rad_s=2.0, acceleration_rad_s2=150.0, angle_rad=0.5)


def _turn(
    q_rad: Float64Array, joint: int, *, speed_rad_s: float, acceleration_rad_s2: float, angle_rad: float
) -> JointTrajectory:
    """One joint turns with a trapezoid of speed, in samples of 1 ms."""
    rising_s = speed_rad_s / acceleration_rad_s2
    end_s = angle_rad / speed_rad_s + rising_s
    t = np.arange(0.0, end_s + 1e-3, 1e-3)
    speed = np.clip(np.minimum(t, end_s - t) * acceleration_rad_s2, 0.0, speed_rad_s)
    q, dq = np.tile(q_rad, (len(t), 1)), np.zeros((len(t), 7))
    q[1:, joint] += np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))
    dq[:, joint] = speed
    return JointTrajectory(times_s=t, q_rad=q, dq_rad_s=dq, ddq_rad_s2=np.zeros_like(q))


async def froze(server: FrankaSimServer, robot: FrankaRobot, name: str) -> None:
    """The process that streams set-points does nothing for a while, as on a machine that swaps."""
    os.kill(robot.pids["stream"], signal.SIGSTOP)
    time.sleep(FREEZE_S)  # noqa: ASYNC251  the driver has nothing to do meanwhile
    os.kill(robot.pids["stream"], signal.SIGCONT)


async def aborted(server: FrankaSimServer, robot: FrankaRobot, name: str) -> None:
    """The arm itself ends the motion, for a reason that no torque and no communication can give it in franka-sim."""
    server.abort(name)


async def provoked(
    server: FrankaSimServer,
    robot: FrankaRobot,
    name: str,
    by: Callable[[FrankaSimServer, FrankaRobot, str], Awaitable[None]] | None,
    motion: Callable[[Float64Array], JointTrajectory] | None,
) -> SkillFailure:
    begin = robot.state().q_rad
    trajectory = scaled(joint_move(begin, AWAY_RAD, FR3.limits), 0.3) if motion is None else motion(begin)
    moving = asyncio.ensure_future(robot.follow(trajectory, LEASE))
    if by is not None:
        await asyncio.sleep(0.5)
        await by(server, robot, name)
    with pytest.raises(SkillFailure) as failure:
        await moving
    return failure.value


PROVOKED: list[Any] = [
    (COMMUNICATION, "reflex", froze, None),
    ("joint_velocity_violation", "fault", None, too_fast),
    ("tau_j_range_violation", "fault", None, too_strong),
    ("controller_torque_discontinuity", "reflex", aborted, None),
    ("joint_motion_generator_velocity_limits_violation", "fault", aborted, None),
    ("joint_motion_generator_velocity_discontinuity", "reflex", aborted, None),
    ("joint_motion_generator_acceleration_discontinuity", "reflex", aborted, None),
]
"""Reflex, the failure's reason, and what provokes it."""


@pytest.mark.parametrize(("name", "reason", "by", "motion"), PROVOKED, ids=[row[0] for row in PROVOKED])
def test_a_reflex_is_named_and_the_next_motion_runs_after_a_recovery(
    name: str,
    reason: str,
    by: Any,
    motion: Any,
    server: FrankaSimServer,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(limits, "MOST_SPEED", 2.0)  # the arm's own limits are tried

    async def scenario(robot: FrankaRobot) -> None:
        failure = await provoked(server, robot, name, by, motion)
        assert failure.reason == reason, failure
        assert {each.lower() for each in _reflexes(server)} == (set() if by is aborted else {name})
        assert name in failure.detail
        # Late and jumping set-points are recovered by the task, once an action; what asked for too much ends it.
        assert remedy_of(failure.reason) is (Remedy.RECOVER if reason == "reflex" else Remedy.NONE)
        assert robot.state().mode is RobotMode.FAULT
        assert not robot.state().stop_latched
        with pytest.raises(SkillFailure, match="the arm does not move"):
            await robot.follow(scaled(joint_move(robot.state().q_rad, AWAY_RAD, FR3.limits), 0.2), LEASE)
        await robot.recover()
        assert robot.state().mode is RobotMode.IDLE
        await bring(robot, FR3.home_q_rad)
        np.testing.assert_allclose(robot.state().q_rad, FR3.home_q_rad, atol=0.01)

    run_on(server, tmp_path, scenario)


@pytest.mark.parametrize("name", ["joint_reflex", "cartesian_reflex"])
def test_a_collision_latches_until_a_person_enables_the_arm(name: str, server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        failure = await provoked(server, robot, name, aborted, None)
        assert failure.reason == "collision", failure
        assert name in failure.detail
        assert robot.state().stop_latched
        await robot.recover()
        with pytest.raises(SkillFailure, match="a person must enable it"):
            await robot.follow(scaled(joint_move(robot.state().q_rad, AWAY_RAD, FR3.limits), 0.2), LEASE)
        await robot.enable()
        await bring(robot, FR3.home_q_rad)

    run_on(server, tmp_path, scenario)


def test_a_brake_at_four_fifths_of_the_speed_trips_no_reflex(server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        target = robot.state().q_rad + np.array([2.0, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0])
        moving = asyncio.ensure_future(
            robot.follow(scaled(joint_move(robot.state().q_rad, target, FR3.limits), 0.8), LEASE)
        )
        await asyncio.sleep(0.4)
        await robot.halt()
        with pytest.raises(SkillFailure, match="braked at an order"):
            await moving
        assert np.abs(robot.state().q_rad - target).max() > 0.2  # in mid-motion
        await bring(robot, FR3.home_q_rad)
        assert _reflexes(server) <= {COMMUNICATION}

    run_on(server, tmp_path, scenario)
