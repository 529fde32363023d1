"""A new process that opens a driver and reads whether a stop is latched: the arm keeps it, not the driver's memory."""

import asyncio
import json
import pickle
import subprocess
import sys
from collections.abc import Callable

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.pulse import Pulse, ThreadPulse
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import BadValue, HardwareError
from dlokit.functional.robots.base import Robot

BuildRobot = Callable[[Port, ArmMount, Pulse], Robot]
"""Makes a driver that is not connected yet; as `build` of its settings."""

_LIMIT_S = 60.0
"""Longest time for the new process [s]: it imports dlokit and the driver, and connects; a Franka may take 15 s."""


def driver_port() -> Port:
    """The port of a driver without a system: the clock of the event loop, and nothing to call."""
    return Port(MemoryTransport(), LoopClock(), InlineCompute(), owner="driver", publishes=())


def sent(build: BuildRobot, mount: ArmMount) -> bytes:
    """Driver and arm for `latched_in_new_process`. Raises `BadValue` where a new process could not import `build`."""
    try:
        owner = getattr(build, "__self__", build)
        home = getattr(owner, "__module__", type(owner).__module__)
        if home == "__main__":
            raise AttributeError("it is defined in the script that was started")
        # The folders first: the new process needs them to import the driver.
        return pickle.dumps(sys.path) + pickle.dumps((build, mount))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise BadValue(
            f"a new process must be able to import {build!r}, to see whether the arm keeps a stop: {error}. Give "
            "`build` of the driver's settings, or a function at the top of a module."
        ) from error


async def latched_in_new_process(sent_driver: bytes) -> bool:
    """Whether the state says that the stop is latched, in a new process that connects for this and disconnects.

    Raises `HardwareError` where the process cannot connect, with its last line.
    """

    def ended() -> subprocess.CompletedProcess[bytes]:
        command = [sys.executable, "-m", __name__]
        return subprocess.run(command, input=sent_driver, capture_output=True, timeout=_LIMIT_S, check=False)

    try:
        process = await asyncio.to_thread(ended)
    except subprocess.TimeoutExpired as error:
        raise HardwareError(f"a new process did not open the driver within {_LIMIT_S:g} s") from error
    if process.returncode:
        said = process.stderr.decode(errors="replace").strip().splitlines()
        raise HardwareError(f"a new process could not open the driver: {said[-1] if said else 'it said nothing'}")
    return bool(json.loads(process.stdout.splitlines()[-1]))


async def _latched(build: BuildRobot, mount: ArmMount) -> bool:
    async with build(driver_port(), mount, ThreadPulse()) as robot:
        return robot.state().stop_latched


def main() -> None:
    """Read a driver from the standard input, open it, and print whether its stop is latched."""
    sys.path[:] = pickle.load(sys.stdin.buffer)
    build, mount = pickle.load(sys.stdin.buffer)
    latched = asyncio.run(_latched(build, mount))
    sys.stdout.write(f"\n{json.dumps(latched)}\n")


if __name__ == "__main__":
    main()
