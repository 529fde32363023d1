"""A live cell and arm: `dlokit call`, `stop` and `enable`, and peers without the key of its bus."""

import asyncio
import json
import os
import subprocess
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest
from live_systems import Background, background

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.description.arm.franka import PANDA
from dlokit.functional.robots.gate import GateConfig
from dlokit.skills.robot import api as robot
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.config import RunConfig
from dlokit.system.live import leases_held
from dlokit.system.live_system import LiveSystem
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import RobotState
from parts.arm_and_cell import arm_and_cell
from parts.faults import forging_peer

FAR_RAD = 2.4
"""Target of the first joint: at a tenth of the speed the motion takes 27 s, long enough to interrupt it."""
NEAR_RAD = 0.1
PATIENT = RobotConfig(commander_lease_s=10.0, driver_lease_s=10.0)
"""A busy machine may hold a process up for longer than the usual leases."""
SLOW = RunConfig(runtime="live", gate=GateConfig(speed_scale=0.1), robot=PATIENT)
SHORT_LEASE_S = 0.3
MOVING_RAD_S = 0.05
"""Speed above which an arm is in motion."""
STANDING_RAD_S = 0.01
"""Largest joint speed of an arm at rest, due to the cell's controllers."""
USERS = [
    pytest.param(
        forging_peer.NOBODY,
        id="another user",
        marks=pytest.mark.skipif(os.geteuid() != 0, reason="only root may start a process of another user"),
    ),
    pytest.param(os.getuid(), id="own user"),
]


@pytest.fixture(scope="module")
def loop() -> Generator[Background]:
    with background() as loop:
        yield loop


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("arm")


@pytest.fixture(scope="module")
def live(loop: Background, folder: Path) -> Generator[LiveSystem]:
    with loop.entered(arm_and_cell(folder, SLOW)) as live:
        yield live


def turned(by_rad: float) -> np.ndarray:
    """The home posture with its first joint turned."""
    return np.array(PANDA.home_q_rad) + np.array([by_rad, *[0.0] * 6])


async def dlokit(*arguments: str) -> int:
    """Exit code of a command that runs in a separate thread, as in a separate shell."""
    return await asyncio.to_thread(execute, arguments)


async def until_speed(transport: Transport, lowest_rad_s: float, highest_rad_s: float) -> RobotState:
    """The first state of the arm whose fastest joint has this speed."""
    async for state in transport.stream(topics.ROBOT_STATE):
        if lowest_rad_s <= np.abs(state.dq_rad_s).max() <= highest_rad_s:
            return state
    raise AssertionError("the arm told no more states")


@pytest.mark.smoke
def test_an_arm_is_called_and_stopped_in_the_middle_of_a_motion(
    loop: Background, live: LiveSystem, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def body() -> None:
        assert await dlokit("call", "robot.release", "width_m=0.02", "--run", str(folder)) == 0
        assert capsys.readouterr().out.startswith("succeeded {")
        before = await until_speed(live.transport, 0.0, STANDING_RAD_S)
        assert await dlokit("call", "robot.release", "width_m=0.04", "--dry-run", "--run", str(folder)) == 0
        said = capsys.readouterr().out
        assert "robot.release passes all checks" in said
        assert "40 mm apart; nothing has moved" in said
        after = await until_speed(live.transport, 0.0, STANDING_RAD_S)
        assert abs(after.finger_width_m - before.finger_width_m) < 1e-3
        moving = asyncio.create_task(live.transport.call(robot.MOVE_JOINTS, turned(FAR_RAD)))
        await until_speed(live.transport, MOVING_RAD_S, np.inf)
        # Without a decision process, it is unknown whether a task runs.
        assert await dlokit("stop", "--run", str(folder)) == 3
        lines = capsys.readouterr().out.splitlines()
        assert lines[0] == f"{folder}: the first arm stands, and is stopped until dlokit enable"
        assert lines[1].startswith(f"{folder}: its decision process does not answer")
        outcome = await moving
        assert isinstance(outcome, Failed)
        assert outcome.reason == "stopped"
        stands = await until_speed(live.transport, 0.0, STANDING_RAD_S)
        # Far from its target: at the end of a motion, the distance is a hundredth of this.
        assert np.abs(stands.q_rad - turned(FAR_RAD)).max() > 0.1 * FAR_RAD
        refused = await live.transport.call(robot.HOME)
        assert isinstance(refused, Rejected)
        assert refused.reason == "stop_latched"
        assert await dlokit("enable", "--run", str(folder)) == 0
        assert capsys.readouterr().out == "the first arm is enabled\n"
        assert isinstance(await live.transport.call(robot.HOME), Succeeded)

    loop.run(body())


async def forged(live: LiveSystem, user: int) -> None:
    """Let a peer without the key forge the commander's heartbeats, leases and calls; it must be refused."""
    endpoints = live.bus.connect
    assert {Path(endpoint).name for endpoint in endpoints} == {"bus", "cell", "robot"}
    command = forging_peer.command(user, live.bus.namespace, live.transport.identity, endpoints)
    peer = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
    said, _ = await peer.communicate()
    assert json.loads(said) == forging_peer.REFUSED


@pytest.mark.parametrize("user", USERS)
def test_a_forging_peer_without_the_key_is_refused_and_neither_moves_the_arm_nor_keeps_its_lease(
    loop: Background, live: LiveSystem, folder: Path, user: int
) -> None:
    async def the_task_is_unharmed() -> None:
        async with leases_held(live.transport, live.clock, PATIENT):
            forging = asyncio.create_task(forged(live, user))
            outcomes = list[object]()
            while not forging.done():
                outcomes.append(await live.transport.call(robot.MOVE_JOINTS, turned(NEAR_RAD)))
                outcomes.append(await live.transport.call(robot.HOME))
            await forging
            assert outcomes
            assert all(isinstance(outcome, Succeeded) for outcome in outcomes), outcomes

    async def the_lease_runs_out() -> None:
        """Forged heartbeats do not keep the lease of a lost commander."""
        taken = await live.transport.call(robot.RENEW_LEASE, live.transport.identity, SHORT_LEASE_S)
        assert isinstance(taken, Succeeded)
        await forged(live, user)  # for longer than the lease; the commander itself is silent
        refused = await live.transport.call(robot.HOME)
        assert isinstance(refused, Rejected)
        assert refused.reason == "lease_lost"
        assert isinstance(await live.transport.call(robot.RELEASE_LEASE, live.transport.identity), Succeeded)

    loop.run(the_task_is_unharmed())
    loop.run(the_lease_runs_out())
    logs = [(folder / "logs" / f"{name}.log").read_text() for name in ("cell", "robot")]
    # The kernel refuses another user, who comes first, at the folder, and the processes never hear of it.
    assert all(("refused on the bus: a peer without the key" in log) == (user == os.getuid()) for log in logs)
