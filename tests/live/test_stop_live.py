"""A person's stop of a live run whose decision process does not respond: the arm stops and stays stopped."""

import asyncio
import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from pathlib import Path
from typing import Any

import numpy as np

from dlokit.app.operate.stop import stop_all
from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.errors import InputError
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.table import TimeBase
from dlokit.types.robot import RobotState

Process = subprocess.Popen[bytes]

DLOKIT = Path(sys.executable).with_name("dlokit")
WAIT_S = 120.0  # a run takes half a minute of two idle cores
MOVING_RAD_S = 0.2
STANDS_RAD = 0.02  # of any joint: motion of a held arm under the DLO's force


async def found(folder: Path, *, starting: bool) -> RunningSystem:
    while True:
        with contextlib.suppress(InputError):
            return the_running_system(folder, starting=starting)
        await asyncio.sleep(0.05)


async def until_moving(transport: Transport) -> None:
    async for state in transport.stream(topics.ROBOT_STATE):
        if np.abs(state.dq_rad_s).max() > MOVING_RAD_S:
            return


@contextlib.asynccontextmanager
async def listening(transport: Transport) -> AsyncGenerator[list[RobotState]]:
    """Yield the list that takes the states from now on, once it has its first two."""
    states = list[RobotState]()
    two = asyncio.Event()

    async def listen() -> None:
        async for state in transport.stream(topics.ROBOT_STATE):
            states.append(state)
            if len(states) == 2:
                two.set()

    async with asyncio.TaskGroup() as tasks:
        task = tasks.create_task(listen())
        await two.wait()
        yield states
        task.cancel()


def run_of(folder: Path) -> Process:
    command = ("shape", "--runtime", "live", "--headless", "--goal", "S", "--no-check-camera", "--out", str(folder))
    return subprocess.Popen([str(DLOKIT), *command], stdout=subprocess.DEVNULL)


def test_an_arm_is_stopped_while_its_decision_process_is_frozen_and_stays_stopped_after_the_thaw(
    tmp_path: Path,
) -> None:
    async def body(process: Process) -> None:
        async with asyncio.timeout(WAIT_S):
            system = await found(tmp_path / "run", starting=False)
            async with join_bus(system.bus, TimeBase.MACHINE) as bus:
                await until_moving(bus.transport)
                process.send_signal(signal.SIGSTOP)
                said = list[str]()
                began_s = time.monotonic()
                confirmed_s = list[float]()

                def say(line: str) -> None:
                    said.append(line)
                    confirmed_s.append(time.monotonic() - began_s)

                [stopped] = await stop_all([system], say=say)
                assert "the first arm stands, and is stopped until dlokit enable" in said[0]
                assert not stopped.stands, "nobody said that the task ends"
                assert confirmed_s[0] < confirmed_s[-1]  # the arm's line does not wait for the frozen process
                async with listening(bus.transport) as states:
                    process.send_signal(signal.SIGCONT)
                    await asyncio.to_thread(process.wait, WAIT_S)
        q_rad = np.array([state.q_rad for state in states])
        assert np.ptp(q_rad, axis=0).max() < STANDS_RAD
        assert all(state.stop_latched for state in states)
        result = json.loads((tmp_path / "run" / "result.json").read_text())
        assert result["outcome"] in ("failed", "cancelled"), result

    ends(body, run_of(tmp_path / "run"))


def test_a_system_that_is_stopped_while_it_starts_never_moves_its_arm(tmp_path: Path) -> None:
    async def body(process: Process) -> None:
        async with asyncio.timeout(WAIT_S):
            system = await found(tmp_path / "run", starting=True)
            assert system.starting
            await stop_all([system])
            async with join_bus(system.bus, TimeBase.MACHINE) as bus, listening(bus.transport) as states:
                await asyncio.to_thread(process.wait, WAIT_S)
        assert np.ptp(np.array([state.q_rad for state in states]), axis=0).max() < STANDS_RAD
        result = json.loads((tmp_path / "run" / "result.json").read_text())
        assert result["outcome"] == "failed"
        assert "stop" in result["reason"]

    ends(body, run_of(tmp_path / "run"))


def ends(body: Callable[[Process], Coroutine[Any, Any, None]], process: Process) -> None:
    """Run it, and end all its processes in any case."""
    try:
        asyncio.run(body(process))
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(WAIT_S)
        process.kill()
