"""The age of messages that a reader receives which needs more time for each than the publisher's period.

Run as a program, it is the reader: it reads its plan from standard input and writes the ages when that ends.
"""

import asyncio
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from uuid import uuid4

import msgspec

from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.skill import SkillCall
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import MachineError
from dlokit.system.processes.sockets import LocalBus, local_bus
from parts.bus_far_end import READY
from parts.bus_load import FAST, NEAR, SLOW_SIZE, body_of, load_now
from parts.bus_near_end import FOUND_S, SETTLE_S, far_process, result_of

NEEDS_S = 0.05
PERIOD_S = 0.01
_FAR = "slow_reader"


class SlowPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What the reader's process needs to know."""

    bus: ZenohConfig
    way: str
    """One of `WAYS`."""


class SlowTimes(msgspec.Struct, frozen=True, kw_only=True):
    """The times measured with one kind of reader."""

    way: str
    ages_s: list[float]
    """Of the messages when they were read."""
    puts_s: list[float]
    """That the publisher spent in `publish`."""


async def _wait() -> None:
    await asyncio.sleep(NEEDS_S)


async def _block() -> None:
    time.sleep(NEEDS_S)  # noqa: ASYNC251 - a component that blocks its loop is what is measured


async def _hold() -> None:
    """Keep the interpreter for itself, as a library does that never lets go of it."""
    per_call = 200_000
    until_s = time.monotonic() + NEEDS_S
    while time.monotonic() < until_s:
        sum(range(per_call))  # one call of C of 2 ms or more


async def _nothing() -> None:
    return


WAYS: dict[str, Callable[[], Awaitable[None]]] = {
    "needs no time": _nothing,
    "waits 50 ms": _wait,
    "blocks its loop for 50 ms": _block,
    "keeps the interpreter for 50 ms": _hold,
}


def measure_slow_readers(seconds: float, said: Callable[[str], object]) -> list[SlowTimes]:
    """Publish at 100 Hz for `seconds` to a reader of each kind; `said` receives the progress."""
    measured: list[SlowTimes] = []
    for way in WAYS:
        said(f"a reader that {way}, {seconds:g} s")
        with local_bus(f"dlokit_bench/{uuid4().hex}") as bus:
            measured.append(asyncio.run(_measure(bus, way, seconds)))
    return measured


async def _measure(bus: LocalBus, way: str, seconds: float) -> SlowTimes:
    plan = SlowPlan(bus=bus.process("far", ("far",)), way=way)
    transport = ZenohTransport(bus.first())
    port = Port(transport, LoopClock(), InlineCompute(), owner=NEAR, publishes=(FAST,))
    try:
        with far_process("parts.bus_slow_reader", msgspec.json.encode(plan)) as far:
            if not await transport.wait_for(_FAR, FOUND_S):
                raise MachineError("the slow reader was not found on the bus; end other programs, and try again")
            await asyncio.sleep(SETTLE_S)
            puts_s = await _publish(port, round(seconds / PERIOD_S))
            ages_s = msgspec.json.decode(await asyncio.to_thread(result_of, far), type=list[float])
    finally:
        await transport.close()
    return SlowTimes(way=way, ages_s=ages_s, puts_s=puts_s)


async def _publish(port: Port, count: int) -> list[float]:
    body = body_of(SLOW_SIZE)
    puts_s: list[float] = []
    due_s = time.monotonic()
    for _ in range(count):
        began_s = time.monotonic()
        port.publish(FAST, load_now(body))
        puts_s.append(time.monotonic() - began_s)
        due_s += PERIOD_S
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))
    return puts_s


async def _read(plan: SlowPlan) -> list[float]:
    transport = ZenohTransport(plan.bus)
    stream = transport.stream(FAST)
    ages_s: list[float] = []
    first = asyncio.Event()

    async def read_all() -> None:
        async for _ in stream:
            ages_s.append(stream.age_s)
            first.set()
            await WAYS[plan.way]()

    reading = asyncio.create_task(read_all())
    transport.serve(_FAR, _unanswered)
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.buffer.read)
    with suppress(TimeoutError):
        async with asyncio.timeout(FOUND_S):  # on a busy machine the end of the input may overtake the first message
            await first.wait()
    reading.cancel()
    await transport.close()
    return ages_s


async def _unanswered(call: SkillCall, report: Callable[[bytes], None]) -> bytes:
    return b""


def main() -> None:
    """Read until standard input ends."""
    plan = msgspec.json.decode(sys.stdin.buffer.readline(), type=SlowPlan)
    ages_s = asyncio.run(_read(plan))
    sys.stdout.buffer.write(msgspec.json.encode(ages_s) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
