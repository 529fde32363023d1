"""`dlokit call` and `dlokit stop` with a live cell and arm, each in its own process."""

import asyncio
from pathlib import Path

import numpy as np
import pytest
from live_arm import arm_and_cell

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.description.arm.franka import PANDA
from dlokit.functional.robots.gate import GateConfig
from dlokit.skills.robot import api as robot
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.config import RunConfig
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import RobotState

WAIT_S = 120.0  # both processes are up within 10 s of two idle cores
FAR_RAD = 2.4
"""Target of the first joint: at a tenth of the speed the motion takes 27 s, long enough to interrupt it."""
SLOW = RunConfig(runtime="live", gate=GateConfig(speed_scale=0.1), robot=RobotConfig(driver_lease_s=10.0))
"""A busy machine may hold a process up for longer than the driver's usual lease."""
MOVING_RAD_S = 0.05
"""Speed above which an arm is in motion."""
STANDING_RAD_S = 0.01
"""Largest joint speed of an arm at rest, due to the cell's controllers."""


async def dlokit(*arguments: str) -> int:
    """Exit code of a command that runs in a separate thread, as in a separate shell."""
    return await asyncio.to_thread(execute, arguments)


async def until_speed(transport: Transport, lowest_rad_s: float, highest_rad_s: float) -> RobotState:
    """The first state of the arm whose fastest joint has this speed."""
    async for state in transport.stream(topics.ROBOT_STATE):
        if lowest_rad_s <= np.abs(state.dq_rad_s).max() <= highest_rad_s:
            return state
    raise AssertionError("the arm told no more states")


def test_an_arm_is_called_and_stopped_in_the_middle_of_a_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far_rad = np.array(PANDA.home_q_rad) + np.array([FAR_RAD, *[0.0] * 6])

    async def body() -> None:
        async with asyncio.timeout(WAIT_S), arm_and_cell(tmp_path, SLOW) as live:
            assert await dlokit("call", "robot.release", "width_m=0.02", "--run", str(tmp_path)) == 0
            assert capsys.readouterr().out.startswith("succeeded {")
            before = await until_speed(live.transport, 0.0, STANDING_RAD_S)
            assert await dlokit("call", "robot.release", "width_m=0.04", "--dry-run", "--run", str(tmp_path)) == 0
            said = capsys.readouterr().out
            assert "robot.release passes all checks" in said
            assert "40 mm apart; nothing has moved" in said
            after = await until_speed(live.transport, 0.0, STANDING_RAD_S)
            assert abs(after.finger_width_m - before.finger_width_m) < 1e-3
            moving = asyncio.create_task(live.transport.call(robot.MOVE_JOINTS, far_rad))
            await until_speed(live.transport, MOVING_RAD_S, np.inf)
            # Without a decision process, it is unknown whether a task runs.
            assert await dlokit("stop", "--run", str(tmp_path)) == 3
            said = capsys.readouterr().out.splitlines()
            assert said[0] == f"{tmp_path}: the first arm stands, and is stopped until dlokit enable"
            assert said[1].startswith(f"{tmp_path}: its decision process does not answer")
            outcome = await moving
            assert isinstance(outcome, Failed)
            assert outcome.reason == "stopped"
            stands = await until_speed(live.transport, 0.0, STANDING_RAD_S)
            # Far from its target: at the end of a motion, the distance is a hundredth of this.
            assert np.abs(stands.q_rad - far_rad).max() > 0.1 * FAR_RAD
            refused = await live.transport.call(robot.HOME)
            assert isinstance(refused, Rejected)
            assert refused.reason == "stop_latched"
            assert await dlokit("enable", "--run", str(tmp_path)) == 0
            assert capsys.readouterr().out == "the first arm is enabled\n"
            assert isinstance(await live.transport.call(robot.HOME), Succeeded)

    asyncio.run(body())
