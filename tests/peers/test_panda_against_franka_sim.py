"""The driver's link to a Panda, franka-rs, against franka-sim, which speaks the protocol of an FR3: `make test-peers`.

No simulator speaks a Panda's version of the protocol. franka-rs speaks both versions through the same calls, so that
this runs the code of dlokit and of its loop, with the limits of the Panda's model, and nothing of the Panda's protocol.
"""

import asyncio
import os
import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from franka_sim_server import FrankaSimServer, why_not

from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import HardwareError, SkillFailure
from dlokit.extras.franka.driver import FrankaRobot, FrankaRobotConfig
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.robot import JointTrajectory, Lease, RobotMode
from parts.franka_commander import franka

pytestmark = [pytest.mark.peers, pytest.mark.skipif(bool(why_not()), reason=why_not() or "it can run")]

LEASE = Lease(holder="test", duration_s=0.2)
AWAY_RAD = PANDA.home_q_rad + np.array([0.9, 0.4, -0.5, 0.6, 0.4, 0.5, -0.6])
COMMUNICATION = "communication_constraints_violation"
BAR_LOST_S = 1.5


@pytest.fixture
def server(tmp_path: Path) -> Iterator[FrankaSimServer]:
    with FrankaSimServer(tmp_path) as server:
        yield server


def run_on(server: FrankaSimServer, folder: Path, scenario: Callable[[FrankaRobot], Awaitable[None]]) -> None:
    async def main() -> None:
        async with franka(server.address, folder, PANDA) as robot:
            await robot.follow(scaled(joint_move(robot.state().q_rad, PANDA.home_q_rad, PANDA.limits), 0.2), LEASE)
            await scenario(robot)

    asyncio.run(main())


def away(robot: FrankaRobot, pace: float = 0.3) -> JointTrajectory:
    return scaled(joint_move(robot.state().q_rad, AWAY_RAD, PANDA.limits), pace)


@pytest.mark.parametrize(("pace", "allowed_rad"), [(0.1, 0.01), (0.3, 0.02)])
def test_it_tracks_a_planned_motion(server: FrankaSimServer, tmp_path: Path, pace: float, allowed_rad: float) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        result = await robot.follow(away(robot, pace), LEASE)
        assert result.largest_joint_error_rad <= allowed_rad
        np.testing.assert_allclose(result.q_rad, AWAY_RAD, atol=0.005)

    run_on(server, tmp_path, scenario)


def test_a_motion_that_it_cannot_track_ends_by_its_name_and_the_arm_stands(
    server: FrankaSimServer, tmp_path: Path
) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        with pytest.raises(SkillFailure, match="tracking"):
            await robot.follow(away(robot, 1.0), LEASE)
        await asyncio.sleep(0.5)
        assert np.abs(robot.state().dq_rad_s).max() < 0.02
        await robot.follow(away(robot, 0.2), LEASE)

    run_on(server, tmp_path, scenario)


def test_a_brake_and_a_stop_hold_the_arm_and_the_stop_is_latched(server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.7)
        await robot.halt()
        with pytest.raises(SkillFailure, match="braked at an order"):
            await moving
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.5)
        began_s = time.monotonic()
        await robot.stop()
        assert time.monotonic() - began_s <= 1.0
        with pytest.raises(SkillFailure, match="a person has stopped"):
            await moving
        stands = robot.state().q_rad
        assert np.abs(stands - AWAY_RAD).max() > 0.1
        with pytest.raises(SkillFailure, match="a person must enable it"):
            await robot.follow(away(robot), LEASE)
        np.testing.assert_allclose(robot.state().q_rad, stands, atol=2e-3)
        await robot.enable()
        await robot.follow(away(robot), LEASE)

    run_on(server, tmp_path, scenario)


def test_late_set_points_are_a_reflex_and_a_collision_latches(server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.7)
        os.kill(robot.pids["stream"], signal.SIGSTOP)
        time.sleep(0.06)  # noqa: ASYNC251  the driver has nothing to do meanwhile
        os.kill(robot.pids["stream"], signal.SIGCONT)
        with pytest.raises(SkillFailure) as late:
            await moving
        assert late.value.reason == "reflex"
        assert COMMUNICATION in late.value.detail
        await robot.recover()
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.5)
        server.abort("joint_reflex")
        with pytest.raises(SkillFailure, match="joint_reflex") as collided:
            await moving
        assert collided.value.reason == "collision"
        assert robot.state().stop_latched
        await robot.recover()
        with pytest.raises(SkillFailure, match="a person must enable it"):
            await robot.follow(away(robot), LEASE)
        await robot.enable()
        assert robot.state().mode is RobotMode.IDLE
        await robot.follow(away(robot), LEASE)

    run_on(server, tmp_path, scenario)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_lost_streaming_process_is_named_and_a_new_connection_moves_on(
    server: FrankaSimServer, tmp_path: Path, number: signal.Signals
) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.7)
        began_s = time.monotonic()
        os.kill(robot.pids["stream"], number)
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert time.monotonic() - began_s <= BAR_LOST_S
        assert failure.value.reason == "robot_lost"
        await robot.recover()
        await robot.follow(away(robot), LEASE)

    run_on(server, tmp_path, scenario)


def test_a_server_that_is_gone_is_named(server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        moving = asyncio.ensure_future(robot.follow(away(robot), LEASE))
        await asyncio.sleep(0.7)
        began_s = time.monotonic()
        server.kill()
        with pytest.raises(SkillFailure) as failure:
            await moving
        assert time.monotonic() - began_s <= BAR_LOST_S
        assert failure.value.reason == "robot_lost"

    run_on(server, tmp_path, scenario)


def test_fingers_hold_what_stops_them_and_open_again(tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        held = await robot.grip(0.0, 20.0, LEASE)
        assert held.held
        assert held.width_m == pytest.approx(0.03, abs=2e-3)
        released = await robot.grip(0.07, 20.0, LEASE)
        assert not released.held
        assert released.width_m == pytest.approx(0.07, abs=2e-3)

    with FrankaSimServer(tmp_path, object_m=0.03) as server:
        run_on(server, tmp_path, scenario)


def test_near_the_end_of_a_joint_it_refuses_by_name(server: FrankaSimServer, tmp_path: Path) -> None:
    async def scenario(robot: FrankaRobot) -> None:
        near = PANDA.home_q_rad.copy()
        near[6] = PANDA.limits.position_upper_rad[6] - 0.05
        with pytest.raises(SkillFailure, match=r"joint_limit: joint 7 would come within 0\.050 rad of its end"):
            await robot.follow(scaled(joint_move(robot.state().q_rad, near, PANDA.limits), 0.2), LEASE)

    run_on(server, tmp_path, scenario)


@pytest.mark.parametrize(
    ("real_time", "said"), [(True, "install a PREEMPT_RT kernel"), (False, "Is the arm on, unlocked")]
)
def test_what_is_missing_on_connecting_is_named(
    real_time: bool, said: str, server: FrankaSimServer, tmp_path: Path
) -> None:
    address = server.address if real_time else "127.0.31.9"
    config = FrankaRobotConfig(address=address, real_time=real_time)

    async def main() -> None:
        async with FrankaRobot(config, ArmMount(model=PANDA), ThreadPulse(), tmp_path):
            pass

    with pytest.raises(HardwareError, match=said):
        asyncio.run(main())
