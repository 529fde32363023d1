"""A process with minimal components: a clock, an echo, and scripted failures."""

import atexit
import os
import sys
import threading

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.port import Compute
from dlokit.communication.skill import Skill
from dlokit.errors import MachineError
from dlokit.system.processes.bus import JoinedBus
from dlokit.system.processes.child import run_child
from dlokit.system.processes.child_process import ChildSpec
from dlokit.types.outcome import Succeeded
from dlokit.types.system import ClockTick

TICK_S = 0.01


def _echo(text: str) -> str:
    """The same text."""
    ...


def _process() -> int:
    """Number of the process that answers."""
    ...


def _threads() -> tuple[str, ...]:
    """Names of the threads of the process that answers."""
    ...


def _hang() -> None:
    """Block the event loop, as a component that never yields does."""
    ...


ECHO = Skill("echo", "echo", _echo, timeout_s=5.0)
WORKER = Skill("echo", "worker", _process, timeout_s=30.0)
THREADS = Skill("echo", "threads", _threads, timeout_s=5.0)
RELAY = Skill("other", "relay", _echo, timeout_s=5.0)
HANG = Skill("echo", "hang", _hang, timeout_s=5.0)


class TinyCell(Component):
    name = "cell"
    publishes = (topics.CLOCK,)

    async def run(self) -> None:
        while True:
            await self.port.clock.sleep(TICK_S)
            self.port.publish(topics.CLOCK, ClockTick(stamp_ns=self.port.clock.now_ns()))


class Echo(Component):
    name = "echo"

    @implements(ECHO)
    async def echo(self, text: str) -> str:
        await self.port.clock.sleep(TICK_S)
        return text

    @implements(WORKER)
    async def worker(self) -> int:
        return await self.port.compute(os.getpid)

    @implements(THREADS)
    async def threads(self) -> tuple[str, ...]:
        return tuple(thread.name for thread in threading.enumerate())

    @implements(HANG)
    async def hang(self) -> None:
        sys.stderr.write("now hanging\n")
        sys.stderr.flush()
        while True:
            pass


class Other(Component):
    name = "other"

    @implements(RELAY)
    async def relay(self, text: str) -> str:
        outcome = await self.port.call(ECHO, text)
        return outcome.result if isinstance(outcome, Succeeded) else ""


class Broken(Component):
    name = "broken"

    async def run(self) -> None:
        atexit.register(sys.stderr.write, "what libraries write while the interpreter ends\n")
        raise RuntimeError("the lamp is not plugged in")


class Unplugged(Component):
    name = "unplugged"

    async def run(self) -> None:
        raise MachineError("port 8080 is in use: end the other viewer,\nor choose another port")


KINDS = {"cell": TinyCell, "echo": Echo, "other": Other, "broken": Broken, "unplugged": Unplugged}


def tiny_components(spec: ChildSpec, bus: JoinedBus, compute: Compute) -> Container:
    host = Container(bus.transport, bus.clock, compute)
    for name in spec.components:
        host.add(KINDS[name]())
    return host


if __name__ == "__main__":
    run_child(tiny_components)
