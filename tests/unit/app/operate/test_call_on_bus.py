"""`dlokit call` on the bus of a running system: outcome, progress, time limit, and what a dry run asks for."""

import asyncio
import io
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import asynccontextmanager
from random import Random
from typing import Any, TypeVar

import msgspec
import pytest
from buses import MemoryBuses, new_bus
from message_examples import example
from rich.console import Console

from dlokit.app.operate.call import FOUND_WITHIN_S, arms_now, call_skill, outcome_line
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, implements_reporting
from dlokit.communication.container import Container
from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import HardwareError, ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.processes.running import RunningSystem
from dlokit.system.table import TimeBase
from dlokit.types.robot import RobotState
from dlokit.types.system import Heartbeat

T = TypeVar("T")


def _count(to: int) -> int:
    """Count up to a number, and report each."""
    ...


def _wait() -> None:
    """Wait until it is cancelled."""
    ...


COUNT = ReportingSkill("worker", "count", _count, timeout_s=60.0, reports=int)
WAIT = Skill("worker", "wait", _wait, timeout_s=60.0)


class Worker(Component):
    name = "worker"

    def __init__(self) -> None:
        self.cancelled_at_s: float | None = None

    @implements_reporting(COUNT)
    async def count(self, report: Callable[[int], None], to: int) -> int:
        for number in range(1, to + 1):
            report(number)
        return to

    @implements(WAIT)
    async def wait(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self.cancelled_at_s = asyncio.get_running_loop().time()


class Call:
    """A running system in memory, and what is printed about a call to it."""

    def __init__(self, time_base: TimeBase = TimeBase.MACHINE) -> None:
        bus = new_bus()
        self.buses = MemoryBuses()
        self.system = RunningSystem(
            pid=1, began_s=0.0, folder="run", namespace=bus.namespace, endpoint=bus.endpoint, time_base=time_base
        )
        self.bus = self.buses.of(self.system)
        self.worker = Worker()
        self._said = io.StringIO()

    @asynccontextmanager
    async def served(self) -> AsyncGenerator[None]:
        host = Container(self.bus, LoopClock())
        host.add(self.worker)
        async with host:
            yield

    async def outcome(self, skill: Skill[..., Any], limit_s: float | None = None, **given: Any) -> str:
        """The line that the command prints at the end."""
        console = Console(file=self._said)
        return outcome_line(await call_skill(self.system, skill, given, limit_s, console, join=self.buses.join))

    @property
    def said(self) -> list[str]:
        return self._said.getvalue().splitlines()


def in_virtual_time(story: Callable[[], Coroutine[Any, Any, T]]) -> T:
    return virtual_time.run(story())


def test_progress_is_printed_and_the_outcome_returned() -> None:
    async def story() -> None:
        call = Call()
        async with call.served():
            assert await call.outcome(COUNT, to=3) == "succeeded 3"
        assert call.said == ["1", "2", "3"]

    in_virtual_time(story)


def test_a_skill_is_cancelled_at_the_limit_of_the_command() -> None:
    async def story() -> None:
        call = Call()
        async with call.served():
            outcome = await call.outcome(WAIT, limit_s=5.0)
        assert outcome == "failed cancelled: it had not ended after 5 s, the limit of --timeout"
        assert call.worker.cancelled_at_s == 5.0

    in_virtual_time(story)


def test_a_component_that_comes_late_is_called_and_one_that_does_not_come_is_unreachable() -> None:
    async def story() -> None:
        late = Call()
        calling = asyncio.create_task(late.outcome(COUNT, to=1))
        await asyncio.sleep(0.9 * FOUND_WITHIN_S)
        async with late.served():
            assert await calling == "succeeded 1"
        assert (await Call().outcome(COUNT, to=1)).startswith("unreachable")

    in_virtual_time(story)


def test_a_system_whose_clock_stands_still_is_not_called() -> None:
    async def story() -> None:
        call = Call(TimeBase.CELL)
        async with call.served():
            with pytest.raises(ProcessFailure, match="no tick of the clock came within 10 s"):
                await call.outcome(COUNT, to=1)
        assert call.said == []

    in_virtual_time(story)


@pytest.mark.parametrize("holder", ["decision", ""])
def test_a_dry_run_knows_the_state_of_each_arm_and_who_commands_them(holder: str) -> None:
    async def story() -> None:
        call, config = Call(), RunConfig(arms=2)
        states = {
            mount.robot: msgspec.structs.replace(example(RobotState, Random(3)), robot=mount.robot)
            for mount in config.mounts
        }

        async def publish() -> None:
            while True:
                for mount in config.mounts:
                    call.bus.publish(topics.ROBOT_STATE.at(mount.instance), states[mount.robot])
                if holder:
                    call.bus.publish(topics.HEARTBEAT, Heartbeat(stamp_ns=0, holder=holder))
                await asyncio.sleep(0.04)

        publishing = asyncio.create_task(publish())
        found, commands = await arms_now(call.system, config, call.buses.join)
        publishing.cancel()
        assert [state.robot for state in found.values()] == list(found) == list(states)
        assert commands == holder

    in_virtual_time(story)


@pytest.mark.parametrize("published_before", [False, True])
def test_an_arm_that_is_silent_is_named_whatever_it_said_before(published_before: bool) -> None:
    async def story() -> None:
        call = Call()
        if published_before:
            call.bus.publish(topics.ROBOT_STATE, example(RobotState, Random(3)))
        with pytest.raises(HardwareError, match=r"no state of the arm first came within 5 s"):
            await arms_now(call.system, RunConfig(), call.buses.join)

    in_virtual_time(story)
