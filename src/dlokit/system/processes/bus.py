"""The bus connection of a process, with the clock of its components."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

from dlokit.communication import topics
from dlokit.communication.calls import CallListener
from dlokit.communication.container import end_tasks
from dlokit.communication.timing.clock import Clock, FollowedClock, LoopClock
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import ProcessFailure
from dlokit.recording.call_log import CallLog
from dlokit.system.table import TimeBase
from dlokit.types.message import Message
from dlokit.types.system import ClockTick


class SystemTransport(Transport, Protocol):
    """The transport of a process in a system, which can also count and await the other processes."""

    call_log: CallListener | None
    """Receives each call of this process."""

    def serving(self, component: str) -> int:
        """Number of other processes that serve a component; it should be one."""
        ...

    async def wait_for(self, component: str, timeout_s: float) -> bool:
        """Wait up to `timeout_s` of machine time until a component is present; returns whether it is."""
        ...


@dataclass(frozen=True)
class JoinedBus:
    """Transport and clock of one process."""

    transport: SystemTransport
    clock: Clock

    async def first_tick(self, timeout_s: float = 10.0) -> None:
        """Wait for the first time of the clock. Raises `ProcessFailure` after `timeout_s` of wall time."""
        if not isinstance(self.clock, FollowedClock):
            return
        try:
            async with asyncio.timeout(timeout_s):
                await self.clock.sleep_until(1)
        except TimeoutError:
            raise ProcessFailure(
                "no_clock",
                f"no tick of the clock came within {timeout_s:g} s; see the log of the cell, or without one of the "
                "robot's process",
            ) from None


@asynccontextmanager
async def join_bus(
    config: ZenohConfig, time_base: TimeBase, open_session: OpenSession = open_session
) -> AsyncGenerator[JoinedBus]:
    """Open the transport; follow the ticks of a cell or of another machine, or publish them, by the time base."""
    clock = clock_of(time_base)
    transport = ZenohTransport(config, clock, open_session)
    try:
        async with ticking(transport, clock, time_base):
            yield JoinedBus(transport, clock)
    finally:
        await transport.close()


CABLES = frozenset({"cell"})
"""Calls of drivers to the cell, which use a cable in a laboratory and are not recorded."""


@contextmanager
def calls_published(transport: SystemTransport, clock: Clock) -> Generator[None]:
    """Publish the skill calls of this process, for the process that records."""

    def publish(topic: Topic[Any], message: Message | Callable[[], Message]) -> None:
        transport.publish(topic, message if isinstance(message, Message) else message())

    transport.call_log = CallLog(clock.now_ns, publish, unlogged=CABLES)
    try:
        yield
    finally:
        transport.call_log = None


class JoinBus(Protocol):
    """A function that joins the bus of a system as another process of this machine, as `join_bus` does."""

    def __call__(self, config: ZenohConfig, time_base: TimeBase, /) -> AbstractAsyncContextManager[JoinedBus]:
        """The transport and the clock of this process, until the context ends."""
        ...


def clock_of(time_base: TimeBase) -> Clock:
    """The clock of a process with this time base."""
    return FollowedClock() if time_base is TimeBase.CELL else LoopClock()


@asynccontextmanager
async def ticking(transport: Transport, clock: Clock, time_base: TimeBase) -> AsyncGenerator[None]:
    """Follow the ticks of another process, or publish them, by the time base."""
    tasks: list[asyncio.Task[None]] = []
    if isinstance(clock, FollowedClock):
        tasks.append(asyncio.create_task(_follow(transport, clock), name="follow the clock"))
    elif time_base is TimeBase.SHARED:
        tasks.append(asyncio.create_task(_give_ticks(transport, clock), name="share the clock"))
    try:
        yield
    finally:
        await end_tasks(*tasks)


async def _give_ticks(transport: Transport, clock: Clock) -> None:
    """Publish the time of this machine at the rate of a cell."""
    assert topics.CLOCK.rate_hz is not None
    while True:
        transport.publish(topics.CLOCK, ClockTick(stamp_ns=clock.now_ns(), real_time_factor=1.0))
        await clock.sleep(1.0 / topics.CLOCK.rate_hz)


async def _follow(transport: Transport, clock: FollowedClock) -> None:
    async for tick in transport.stream(topics.CLOCK):
        clock.tick(tick.stamp_ns)
