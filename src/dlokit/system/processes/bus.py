"""The bus connection of a process, with the clock of its components."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from dlokit.communication import topics
from dlokit.communication.container import end_tasks
from dlokit.communication.timing.clock import Clock, FollowedClock, LoopClock
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import ProcessFailure
from dlokit.system.table import TimeBase
from dlokit.types.system import ClockTick


@dataclass(frozen=True)
class JoinedBus:
    """Transport and clock of one process."""

    transport: ZenohTransport
    clock: Clock

    async def first_tick(self, timeout_s: float) -> None:
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
    """Open the transport; follow the ticks of a cell or of another machine, or give them, as the time base says."""
    clock = FollowedClock() if time_base is TimeBase.CELL else LoopClock()
    transport = ZenohTransport(config, clock, open_session)
    ticking: list[asyncio.Task[None]] = []
    try:
        if isinstance(clock, FollowedClock):
            ticking.append(asyncio.create_task(_follow(transport, clock), name="follow the clock"))
        elif time_base is TimeBase.SHARED:
            ticking.append(asyncio.create_task(_give_ticks(transport, clock), name="share the clock"))
        yield JoinedBus(transport, clock)
    finally:
        await end_tasks(*ticking)
        await transport.close()


async def _give_ticks(transport: ZenohTransport, clock: Clock) -> None:
    """Publish the time of this machine at the rate of a cell."""
    assert topics.CLOCK.rate_hz is not None
    while True:
        transport.publish(topics.CLOCK, ClockTick(stamp_ns=clock.now_ns(), real_time_factor=1.0))
        await clock.sleep(1.0 / topics.CLOCK.rate_hz)


async def _follow(transport: ZenohTransport, clock: FollowedClock) -> None:
    async for tick in transport.stream(topics.CLOCK):
        clock.tick(tick.stamp_ns)
