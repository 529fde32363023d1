"""Requirements on every transport: call, serve, alive and cancel."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from buses import new_bus
from transport_grid import (
    PATIENT,
    WAIT_S,
    Bus,
    Grid,
    eventually,
    over_zenoh,
)

from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.skill import Skill
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.types.outcome import Cancelled, Failed, Rejected, Succeeded, TimedOut, Unreachable


def _double(value: float) -> float:
    """Twice the value."""
    ...


def _wait(until_released: bool = True) -> None:
    """Wait until the test ends it."""
    ...


DOUBLE = Skill("worker", "double", _double, timeout_s=5.0)
FAIL = Skill("worker", "fail", _double, timeout_s=5.0)
REFUSE = Skill("worker", "refuse", _double, timeout_s=5.0)
WAIT = Skill("worker", "wait", _wait, timeout_s=60.0)
WAIT_LONGER = Skill("worker", "wait_longer", _wait, timeout_s=60.0)
WAIT_BRIEFLY = Skill("worker", "wait_briefly", _wait, timeout_s=0.05)
LOSE = Skill("worker", "lose", _double, timeout_s=5.0)


class Worker(Component):
    name = "worker"

    def __init__(self) -> None:
        self.started = asyncio.Event()
        self.cleaned_up = asyncio.Event()
        self.waiting = 0

    @implements(DOUBLE)
    async def double(self, value: float) -> float:
        return 2.0 * value

    @implements(FAIL)
    async def fail(self, value: float) -> float:
        raise SkillFailure("too_hot", f"{value} degrees")

    @implements(REFUSE)
    async def refuse(self, value: float) -> float:
        raise SkillRejected("not_now", f"{value} is early")

    @implements(LOSE)
    async def lose(self, value: float) -> float:
        raise ZeroDivisionError("a mistake in the skill")

    @implements(WAIT)
    async def wait(self, until_released: bool = True) -> None:
        self.started.set()
        self.waiting += 1
        try:
            await asyncio.Event().wait()
        finally:
            self.waiting -= 1
            self.cleaned_up.set()

    @implements(WAIT_LONGER)
    async def wait_longer(self, until_released: bool = True) -> None:
        await self.wait(until_released)

    @implements(WAIT_BRIEFLY)
    async def wait_briefly(self, until_released: bool = True) -> None:
        await self.wait(until_released)


@asynccontextmanager
async def working(bus: Bus) -> AsyncGenerator[Worker]:
    host = Container(bus.there, LoopClock())
    worker = Worker()
    host.add(worker)
    async with host:
        yield worker


def test_a_call_brings_the_result(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcome = await bus.here.call(DOUBLE, 21.0)
            assert isinstance(outcome, Succeeded)
            assert outcome.result == 42.0

    on_bus(body)


def test_many_calls_at_once_each_get_their_own_answer(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcomes = await asyncio.gather(*(bus.here.call(DOUBLE, float(n)) for n in range(20)))
            assert [outcome.result for outcome in outcomes if isinstance(outcome, Succeeded)] == [
                2.0 * n for n in range(20)
            ]

    on_bus(body)


def test_a_failed_skill_names_its_reason(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcome = await bus.here.call(FAIL, 90.0)
            assert isinstance(outcome, Failed)
            assert (outcome.reason, outcome.detail) == ("too_hot", "90.0 degrees")

    on_bus(body)


def test_a_rejected_skill_names_its_reason(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcome = await bus.here.call(REFUSE, 1.0)
            assert isinstance(outcome, Rejected)
            assert outcome.reason == "not_now"

    on_bus(body)


def test_a_call_that_cannot_be_sent_is_rejected_and_does_not_raise(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcome = await bus.here.call(DOUBLE, object())  # pyright: ignore[reportArgumentType] - on purpose
            assert isinstance(outcome, Rejected)
            assert outcome.reason == "bad_arguments"

    on_bus(body)


def test_a_skill_that_takes_too_long_times_out_and_is_stopped(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus) as worker:
            outcome = await bus.here.call(WAIT_BRIEFLY)
            assert isinstance(outcome, TimedOut)
            assert outcome.timeout_s == WAIT_BRIEFLY.timeout_s
            assert worker.cleaned_up.is_set()

    on_bus(body)


def test_a_cancelled_caller_stops_the_skill_before_it_goes_on(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus) as worker:
            call = asyncio.create_task(bus.here.call(WAIT))
            async with asyncio.timeout(WAIT_S):
                await worker.started.wait()
                call.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await call
            assert worker.cleaned_up.is_set()

    on_bus(body)


def test_a_component_that_does_not_run_is_unreachable_and_not_alive(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        outcome = await bus.here.call(DOUBLE, 1.0)
        assert isinstance(outcome, Unreachable)
        assert outcome.component == "worker"
        assert not bus.here.alive("worker").alive

    on_bus(body, replace(PATIENT, discovery_s=0.1))


def test_a_component_is_alive_from_its_start_to_its_end(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            await eventually(lambda: bus.here.alive("worker").alive)
        await eventually(lambda: not bus.here.alive("worker").alive)
        assert isinstance(await bus.here.call(DOUBLE, 1.0), Unreachable)

    on_bus(body)


@pytest.mark.live
def test_a_call_that_runs_when_its_component_ends_is_cancelled_and_answered() -> None:
    async def body(bus: Bus) -> None:
        async with working(bus) as worker:
            call = asyncio.create_task(bus.here.call(WAIT))
            async with asyncio.timeout(WAIT_S):
                await worker.started.wait()
        assert isinstance(await call, Cancelled)

    over_zenoh(body)  # in memory, a call runs in the caller's task


@pytest.mark.live
def test_the_running_skills_of_a_lost_caller_are_cancelled_and_no_others() -> None:
    async def main() -> None:
        bus = new_bus()
        serves, dies, lives = (ZenohTransport(each, patience=PATIENT) for each in (bus.first(), bus.guest, bus.guest))
        try:
            async with asyncio.timeout(WAIT_S * 2), working(Bus(dies, serves)) as worker:
                lost = asyncio.create_task(dies.call(WAIT))
                await worker.started.wait()
                worker.started.clear()
                kept = asyncio.create_task(lives.call(WAIT_LONGER))
                await worker.started.wait()
                await dies.close()
                await worker.cleaned_up.wait()
                assert worker.waiting == 1
                await lost
                kept.cancel()
                await asyncio.wait({kept})
                assert worker.waiting == 0
        finally:
            for each in (dies, lives, serves):
                await each.close()

    asyncio.run(main())


def _double_and_add(value: float, more: float = 0.0) -> float:
    """Twice the value, plus `more`."""
    ...


def test_a_call_with_another_schema_is_rejected_by_name(on_bus: Grid, caplog: pytest.LogCaptureFixture) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            outcome = await bus.here.call(Skill("worker", "double", _double_and_add, timeout_s=5.0), 1.0)
            assert isinstance(outcome, Rejected)
            assert outcome.reason == "schema_mismatch"
            assert DOUBLE.schema.hex() in outcome.detail

    on_bus(body)
    assert "calls of worker.double rejected: 1, the last from" in caplog.text
    assert "worker.double did not run" in caplog.text
