"""What the tests of every transport share: two ends of a bus, in memory or over zenoh, and messages to send."""

import asyncio
import itertools
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from buses import new_bus

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.topic import Every, KeepLast, Topic
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.transport import Patience, ZenohTransport
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message

WAIT_S = 60.0
"""A message or an answer takes a millisecond; only a broken transport needs more than this [s]."""
PATIENT = Patience(answer_s=WAIT_S, cancel_s=WAIT_S, discovery_s=WAIT_S)
"""On a busy machine the threads of zenoh may stand still for seconds."""


class Reading(Message, frozen=True, kw_only=True, eq=False):
    values: Float64Array


NEWEST = Topic("test/newest", Reading, "source", None, KeepLast())
EACH = Topic("test/each", Reading, "source", None, Every(4))


def reading(number: int) -> Reading:
    return Reading(stamp_ns=number, seq=number, values=np.array([1.0, number]))


@dataclass
class Bus:
    here: Transport
    there: Transport


@asynccontextmanager
async def memory_bus() -> AsyncGenerator[Bus]:
    bus = MemoryTransport()
    yield Bus(bus, bus)
    await bus.close()


@asynccontextmanager
async def zenoh_bus(patience: Patience = PATIENT) -> AsyncGenerator[Bus]:
    bus = new_bus()
    here, there = (ZenohTransport(config, patience=patience) for config in (bus.first(), bus.guest))
    try:
        yield Bus(here, there)
    finally:  # a session that stays open keeps its process from ending
        await here.close()
        await there.close()


Body = Callable[[Bus], Awaitable[None]]


class Grid(Protocol):
    """Runs a test on one kind of bus; `patience` is that of transports between processes."""

    def __call__(self, body: Body, patience: Patience = PATIENT, /) -> None: ...


def in_memory(body: Body, patience: Patience = PATIENT) -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 10), memory_bus() as bus:
            await body(bus)

    virtual_time.run(main())


def over_zenoh(body: Body, patience: Patience = PATIENT) -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S * 2), zenoh_bus(patience) as bus:
            await body(bus)

    asyncio.run(main())


async def eventually(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(WAIT_S):
        for _ in itertools.count():
            if condition():
                return
            await asyncio.sleep(0.001)


async def connected(bus: Bus) -> None:
    """Wait until the two ends are connected, so that no message published from now on is lost."""
    bus.there.serve("probe", lambda call, report: asyncio.sleep(0, call.arguments))
    await eventually(lambda: bus.here.alive("probe").alive)
    bus.here.serve("probe back", lambda call, report: asyncio.sleep(0, call.arguments))
    await eventually(lambda: bus.there.alive("probe back").alive)


def newest_seq(bus: Bus, topic: Topic[Reading]) -> int:
    value = bus.here.latest(topic).value
    return 0 if value is None else value.seq
