"""The process that receives: run as a program, it reads its plan from standard input and writes what it measured.

It writes `ready` when everything is subscribed, and the delays as one line of JSON when its input ends.
"""

import asyncio
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import msgspec
import zenoh

from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.transport import ZenohTransport
from parts.bus_load import (
    FAR,
    SIZES_BYTES,
    TAKE,
    BusPlan,
    Delay,
    Load,
    bare_session,
    since_load,
    since_stamp,
    topic_of,
)

READY = b"ready\n"
Note = Callable[[str, int, float], None]


class Taker(Component):
    """Takes a message, and says how long it is."""

    name = FAR
    reads = tuple(topic_of(size) for size in SIZES_BYTES)

    def __init__(self, sizes: tuple[int, ...], note: Note) -> None:
        self._sizes = sizes
        self._note = note

    @implements(TAKE)
    async def take(self, load: Load) -> int:
        """Number of values."""
        return len(load.body)

    async def run(self) -> None:
        """Note every message, as a component reads it."""
        await asyncio.gather(*(self._read(size) for size in self._sizes))

    async def _read(self, size: int) -> None:
        async for load in self.port.stream(topic_of(size)):
            self._note("dlokit", size, since_load(load))


class BareZenoh:
    """The same with zenoh alone: messages to a callback, and by way of asyncio; queries by way of asyncio."""

    def __init__(self, session: zenoh.Session, sizes: tuple[int, ...], note: Note) -> None:
        self._loop = asyncio.get_running_loop()
        self._note = note
        self._arrived: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()
        self._declared: list[Any] = [session.declare_queryable("bare/call", self._on_query)]
        for size in sizes:
            self._declared.append(session.declare_subscriber(f"bare/callback/{size}", self._callback(size)))
            self._declared.append(session.declare_subscriber(f"bare/asyncio/{size}", self._to_asyncio(size)))
        self._reading = asyncio.create_task(self._read())
        self._answering: set[asyncio.Task[None]] = set()

    def _callback(self, size: int) -> Callable[[zenoh.Sample], None]:
        return lambda sample: self._note("zenoh", size, since_stamp(sample.payload.to_bytes()))

    def _to_asyncio(self, size: int) -> Callable[[zenoh.Sample], None]:
        def hand_over(sample: zenoh.Sample) -> None:
            data = sample.payload.to_bytes()
            self._loop.call_soon_threadsafe(self._arrived.put_nowait, (size, data))

        return hand_over

    async def _read(self) -> None:
        while True:
            size, data = await self._arrived.get()
            self._note("zenoh, asyncio", size, since_stamp(data))

    def _on_query(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        data = query.payload.to_bytes()
        self._loop.call_soon_threadsafe(self._start, query, data)

    def _start(self, query: zenoh.Query, data: bytes) -> None:
        task = asyncio.create_task(self._answer(query, data))
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)

    async def _answer(self, query: zenoh.Query, data: bytes) -> None:
        query.reply(query.key_expr, len(data).to_bytes(8, "little"))
        query.drop()


def _serve_pyzmq(plan: BusPlan, note: Note) -> None:
    """Messages and calls with pyzmq alone, a thread each."""
    zmq = import_module("zmq")
    context = zmq.Context.instance()

    def take() -> None:
        socket = context.socket(zmq.PULL)
        socket.connect(plan.pushes)
        while True:
            data = socket.recv()
            note("pyzmq", len(data), since_stamp(data))

    def answer() -> None:
        socket = context.socket(zmq.REP)
        socket.connect(plan.answers)
        while True:
            socket.send(len(socket.recv()).to_bytes(8, "little"))

    for work in (take, answer):
        threading.Thread(target=work, daemon=True).start()


async def _serve(plan: BusPlan) -> list[Delay]:
    delays: list[Delay] = []

    def note(method: str, size: int, seconds: float) -> None:
        delays.append(Delay(method=method, size=size, seconds=seconds))

    loop = asyncio.get_running_loop()
    transport = ZenohTransport(plan.bus)
    session = bare_session(connect=(plan.bare_endpoint,))
    bare = BareZenoh(session, plan.sizes, note)
    if plan.pushes:
        _serve_pyzmq(plan, note)
    host = Container(transport, LoopClock())
    host.add(Taker(plan.sizes, note))
    async with host:
        sys.stdout.buffer.write(READY)
        sys.stdout.buffer.flush()
        await loop.run_in_executor(None, sys.stdin.buffer.read)  # until the near end closes it
    del bare
    await transport.close()
    await asyncio.to_thread(session.close)
    return delays


def main() -> None:
    """Serve until standard input ends."""
    plan = msgspec.json.decode(sys.stdin.buffer.readline(), type=BusPlan)
    delays = asyncio.run(_serve(plan))
    sys.stdout.buffer.write(msgspec.json.encode(delays) + b"\n")
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
