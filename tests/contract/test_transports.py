"""One grid over every transport: what publish, read, call, alive and close mean."""

import asyncio
import itertools
import os
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from dlokit.communication import virtual_time
from dlokit.communication.clock import LoopClock
from dlokit.communication.component import Component, implements
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.topic import Every, KeepLast, Topic
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh_session import ZenohConfig
from dlokit.communication.zenoh_transport import ZenohTransport
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message
from dlokit.types.outcome import Cancelled, Failed, Rejected, Succeeded, TimedOut, Unreachable

WAIT_S = 10.0  # a message or an answer takes a millisecond; only a broken transport needs more than this


class Reading(Message, frozen=True, kw_only=True, eq=False):
    values: Float64Array


NEWEST = Topic("test/newest", Reading, "source", None, KeepLast())
EACH = Topic("test/each", Reading, "source", None, Every(4))


def reading(number: int) -> Reading:
    return Reading(stamp_ns=number, seq=number, values=np.array([1.0, number]))


def _double(value: float) -> float:
    """Twice the value."""
    ...


def _wait(until_released: bool = True) -> None:
    """Wait until somebody says that it is enough."""
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


@dataclass
class Bus:
    here: Transport
    there: Transport


@asynccontextmanager
async def memory_bus() -> AsyncGenerator[Bus]:
    bus = MemoryTransport()
    yield Bus(bus, bus)
    await bus.close()


namespaces = (f"dlokit_test/{os.getpid()}/{number}" for number in itertools.count())


@asynccontextmanager
async def zenoh_bus() -> AsyncGenerator[Bus]:
    config = ZenohConfig(namespace=next(namespaces))
    here, there = ZenohTransport(config), ZenohTransport(config)
    yield Bus(here, there)
    await here.close()
    await there.close()


Body = Callable[[Bus], Awaitable[None]]
Grid = Callable[[Body], None]


def in_memory(body: Body) -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 10), memory_bus() as bus:
            await body(bus)

    virtual_time.run(main())


def over_zenoh(body: Body) -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 2), zenoh_bus() as bus:
            await body(bus)

    asyncio.run(main())


@pytest.fixture(params=[in_memory, over_zenoh], ids=["memory", "zenoh"])
def on_bus(request: pytest.FixtureRequest) -> Grid:
    return request.param


async def eventually(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(WAIT_S):
        for _ in itertools.count():
            if condition():
                return
            await asyncio.sleep(0.001)


async def connected(bus: Bus) -> None:
    """Wait until the two ends have found each other, so that nothing published from now on is missed."""
    bus.there.serve("probe", lambda request, report: asyncio.sleep(0, request))
    await eventually(lambda: bus.here.alive("probe").alive)
    bus.here.serve("probe back", lambda request, report: asyncio.sleep(0, request))
    await eventually(lambda: bus.there.alive("probe back").alive)


def test_nothing_is_known_of_a_topic_before_its_first_message(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        latest = bus.here.latest(NEWEST)
        assert latest.value is None
        assert latest.age_s == float("inf")

    on_bus(body)


def test_a_published_message_arrives_whole_and_read_only(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        bus.here.latest(NEWEST)
        await connected(bus)
        bus.there.publish(NEWEST, reading(7))
        await eventually(lambda: bus.here.latest(NEWEST).value is not None)
        value = bus.here.latest(NEWEST).value
        assert value is not None
        assert (value.stamp_ns, value.seq) == (7, 7)
        np.testing.assert_array_equal(value.values, [1.0, 7.0])
        assert not value.values.flags.writeable
        assert 0.0 <= bus.here.latest(NEWEST).age_s < WAIT_S

    on_bus(body)


def test_a_publisher_reads_its_own_messages(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        bus.here.publish(EACH, reading(1))
        async with asyncio.timeout(WAIT_S):
            assert (await anext(stream)).seq == 1

    on_bus(body)


def test_a_stream_keeps_the_order(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await connected(bus)
        async with asyncio.timeout(WAIT_S):
            for number in range(1, 51):
                bus.there.publish(EACH, reading(number))
                assert (await anext(stream)).seq == number

    on_bus(body)


def test_a_slow_reader_of_every_message_loses_the_oldest_beyond_the_depth(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await connected(bus)
        for number in range(1, 11):
            bus.there.publish(EACH, reading(number))
        await eventually(lambda: _seq(bus, EACH) == 10)
        async with asyncio.timeout(WAIT_S):
            assert [(await anext(stream)).seq for _ in range(4)] == [7, 8, 9, 10]

    on_bus(body)


def test_a_slow_reader_of_a_state_sees_only_the_newest(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(NEWEST))
        await connected(bus)
        for number in range(1, 11):
            bus.there.publish(NEWEST, reading(number))
        await eventually(lambda: _seq(bus, NEWEST) == 10)
        async with asyncio.timeout(WAIT_S):
            assert (await anext(stream)).seq == 10

    on_bus(body)


def _seq(bus: Bus, topic: Topic[Reading]) -> int:
    value = bus.here.latest(topic).value
    return 0 if value is None else value.seq


@pytest.mark.parametrize("topic", [NEWEST, EACH], ids=["keep last", "every"])
def test_whoever_asks_late_gets_the_last_message(on_bus: Grid, topic: Topic[Reading]) -> None:
    async def body(bus: Bus) -> None:
        bus.there.publish(topic, reading(1))
        bus.there.publish(topic, reading(2))
        await eventually(lambda: _seq(bus, topic) == 2)

    on_bus(body)


def test_a_late_stream_begins_with_the_last_message_only_where_asked(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        await connected(bus)
        bus.there.publish(NEWEST, reading(1))
        informed = aiter(bus.here.stream(NEWEST, with_last=True))
        plain = aiter(bus.here.stream(NEWEST))
        async with asyncio.timeout(WAIT_S):
            assert (await anext(informed)).seq == 1
            bus.there.publish(NEWEST, reading(2))
            assert (await anext(plain)).seq == 2
            assert (await anext(informed)).seq == 2

    on_bus(body)


@asynccontextmanager
async def working(bus: Bus) -> AsyncGenerator[Worker]:
    host = Host(bus.there, LoopClock())
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


def test_a_component_that_nobody_runs_is_unreachable_and_not_alive(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        outcome = await bus.here.call(DOUBLE, 1.0)
        assert isinstance(outcome, Unreachable)
        assert outcome.component == "worker"
        assert not bus.here.alive("worker").alive

    on_bus(body)


def test_a_component_is_alive_from_its_start_to_its_end(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        async with working(bus):
            await eventually(lambda: bus.here.alive("worker").alive)
        await eventually(lambda: not bus.here.alive("worker").alive)
        assert isinstance(await bus.here.call(DOUBLE, 1.0), Unreachable)

    on_bus(body)


def test_streams_end_when_the_transport_closes(on_bus: Grid) -> None:
    async def body(bus: Bus) -> None:
        stream = aiter(bus.here.stream(EACH))
        await bus.here.close()
        with pytest.raises(StopAsyncIteration):
            await anext(stream)

    on_bus(body)


def test_a_call_that_runs_when_its_component_ends_is_cancelled_and_answered() -> None:
    async def body(bus: Bus) -> None:
        async with working(bus) as worker:
            call = asyncio.create_task(bus.here.call(WAIT))
            async with asyncio.timeout(WAIT_S):
                await worker.started.wait()
        assert isinstance(await call, Cancelled)

    over_zenoh(body)  # in memory a call runs in its caller's own task


def test_a_caller_that_is_gone_has_its_running_skills_cancelled_and_nobody_else() -> None:
    async def main() -> None:
        config = ZenohConfig(namespace=next(namespaces))
        dies, lives, serves = ZenohTransport(config), ZenohTransport(config), ZenohTransport(config)
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
        await lives.close()
        await serves.close()

    asyncio.run(main())


def test_runs_side_by_side_do_not_hear_each_other() -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 2), zenoh_bus() as mine, zenoh_bus() as theirs:
            for bus in (mine, theirs):
                bus.here.latest(NEWEST)
                await connected(bus)
            mine.there.publish(NEWEST, reading(1))
            theirs.there.publish(NEWEST, reading(2))
            await eventually(lambda: _seq(mine, NEWEST) > 0 and _seq(theirs, NEWEST) > 0)
            assert (_seq(mine, NEWEST), _seq(theirs, NEWEST)) == (1, 2)

    asyncio.run(main())
