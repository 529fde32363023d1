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
                "no_clock", f"no tick of the cell's clock came within {timeout_s:g} s; see the cell's log"
            ) from None


@asynccontextmanager
async def join_bus(
    config: ZenohConfig, time_base: TimeBase, open_session: OpenSession = open_session
) -> AsyncGenerator[JoinedBus]:
    """Open the transport; follow the cell's ticks if they are the time base."""
    clock = FollowedClock() if time_base is TimeBase.CELL else LoopClock()
    transport = ZenohTransport(config, clock, open_session)
    following: asyncio.Task[None] | None = None
    try:
        if isinstance(clock, FollowedClock):
            following = asyncio.create_task(_follow(transport, clock), name="follow the cell's clock")
        yield JoinedBus(transport, clock)
    finally:
        if following is not None:
            await end_tasks(following)
        await transport.close()


async def _follow(transport: ZenohTransport, clock: FollowedClock) -> None:
    async for tick in transport.stream(topics.CLOCK):
        clock.tick(tick.stamp_ns)
