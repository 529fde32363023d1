"""The process that sends: our bus, bare zenoh and bare pyzmq in turns, so that all of them meet the same machine."""

import asyncio
import importlib
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from uuid import uuid4

import msgspec
import zenoh

from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import MachineError
from dlokit.system.processes.sockets import LocalBus, local_bus
from dlokit.types.outcome import Succeeded
from parts.bus_far_end import READY
from parts.bus_load import (
    FAR,
    NEAR,
    TAKE,
    BusPlan,
    Delay,
    bare_session,
    body_of,
    load_now,
    stamped,
    topic_of,
)

FOUND_S = 20.0
FAR_END_S = 60.0
"""For the other process to end and to write what it has measured."""
FOLDER = Path(__file__).parents[1]
"""From where the modules of the study are importable."""
SETTLE_S = 0.5
"""For what is still on its way when the far end was heard."""
PAUSE_S = 0.002
PAUSE_S_PER_BYTE = 4e-9
"""Between messages, so that none waits for the one before."""

Send = Callable[[], None]
Call = Callable[[], Awaitable[None]]


class NearEnd:
    """Ways to send a message of one size, and ways to call with it, by method."""

    def __init__(self, plan: BusPlan, transport: ZenohTransport, session: zenoh.Session, sockets: "ZmqSockets | None"):
        self._session = session
        self._sockets = sockets
        self._port = Port(
            transport,
            LoopClock(),
            InlineCompute(),
            owner=NEAR,
            publishes=tuple(topic_of(size) for size in plan.sizes),
        )
        self._publishers = {
            (way, size): session.declare_publisher(f"bare/{way}/{size}")
            for way in ("callback", "asyncio")
            for size in plan.sizes
        }

    def sends(self, size: int) -> dict[str, Send]:
        """How each method sends one message."""
        topic, body, buffer = topic_of(size), body_of(size), bytearray(size)
        callback, via_asyncio = self._publishers["callback", size], self._publishers["asyncio", size]
        ways: dict[str, Send] = {
            "dlokit": lambda: self._port.publish(topic, load_now(body)),
            "zenoh": lambda: callback.put(stamped(buffer)),
            "zenoh, asyncio": lambda: via_asyncio.put(stamped(buffer)),
        }
        sockets = self._sockets
        if sockets is not None:
            ways["pyzmq"] = lambda: sockets.push(stamped(buffer))
        return ways

    async def heard(self) -> bool:
        """Wait until bare zenoh's subscriptions have come from the far end; False when they do not."""
        end_s = time.monotonic() + FOUND_S
        # Its stub takes the status for a bool.
        while not all(each.matching_status.matching for each in self._publishers.values()):  # pyright: ignore[reportAttributeAccessIssue]
            if time.monotonic() > end_s:
                return False
            await asyncio.sleep(PAUSE_S)
        return True

    def calls(self, size: int) -> dict[str, Call]:
        """How each method calls once, and waits for the answer."""
        body, buffer = body_of(size), bytearray(size)

        async def ours() -> None:
            outcome = await self._port.call(TAKE, load_now(body))
            if not isinstance(outcome, Succeeded):
                raise MachineError(f"the bench's own call was not answered: {outcome}; end other programs")

        ways: dict[str, Call] = {"dlokit": ours, "zenoh, asyncio": lambda: self._query(buffer)}
        sockets = self._sockets
        if sockets is not None:
            ways["pyzmq"] = lambda: sockets.ask(buffer)
        return ways

    async def _query(self, data: bytearray) -> None:
        loop = asyncio.get_running_loop()
        answered: asyncio.Future[bytes] = loop.create_future()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                loop.call_soon_threadsafe(answered.set_result, reply.ok.payload.to_bytes())

        self._session.get("bare/call", zenoh.handlers.Callback(on_reply, indirect=False), payload=data, timeout=FOUND_S)
        async with asyncio.timeout(FOUND_S):
            await answered


class ZmqSockets:
    """Bare pyzmq's near end."""

    def __init__(self, zmq: Any) -> None:
        self._context = zmq.Context()
        self._push = self._context.socket(zmq.PUSH)
        self._request = self._context.socket(zmq.REQ)
        self._request.setsockopt(zmq.RCVTIMEO, round(FOUND_S * 1e3))
        self.pushes = self._bound(self._push)
        self.answers = self._bound(self._request)

    @staticmethod
    def _bound(socket: Any) -> str:
        return f"tcp://127.0.0.1:{socket.bind_to_random_port('tcp://127.0.0.1')}"

    def push(self, data: bytearray) -> None:
        """One message."""
        self._push.send(data)

    async def ask(self, data: bytearray) -> None:
        """One call; the thread waits for the answer, as nobody else has anything to do."""
        self._request.send(data)
        self._request.recv()

    def close(self) -> None:
        """Of both sockets."""
        self._context.destroy(linger=0)


async def send_all(
    near: NearEnd, plan: BusPlan, transport: ZenohTransport, repeats: int, said: Callable[[str], object]
) -> list[Delay]:
    """Send and call with every method in turns; the delays of the calls. Those of the messages the far end has."""
    if not (await transport.wait_for(FAR, FOUND_S) and await near.heard()):
        raise MachineError("the process at the far end was not found on the bus; end other programs, and try again")
    await asyncio.sleep(SETTLE_S)
    delays: list[Delay] = []
    for size in plan.sizes:
        said(f"{repeats} messages and calls of {size} bytes with each method")
        sends, calls = near.sends(size), near.calls(size)
        pause_s = PAUSE_S + size * PAUSE_S_PER_BYTE
        for _ in range(repeats):
            for send in sends.values():
                send()
                await asyncio.sleep(pause_s)
            for method, call in calls.items():
                began_s = time.monotonic()
                await call()
                delays.append(Delay(method=method, size=size, seconds=time.monotonic() - began_s))
                await asyncio.sleep(PAUSE_S)
    return delays


@dataclass(frozen=True)
class BusTimes:
    """Seconds under way."""

    one_way: list[Delay]
    """From handing a message over to its reader having it; each method in its own thread or coroutine."""
    calls: list[Delay]
    """From asking to having the answer."""


def compare(repeats: int, said: Callable[[str], object]) -> BusTimes:
    """Send `repeats` messages and calls of each size with each method, without pyzmq where it is not installed.

    `said` receives the progress.
    """
    zmq = _pyzmq()
    sockets = None if zmq is None else ZmqSockets(zmq)
    try:
        with local_bus(f"dlokit_bench/{uuid4().hex}") as bus:
            plan = BusPlan(
                bus=bus.process("far", ("far",)),
                bare_endpoint=f"unixsock-stream/{bus.folder}/bare",
                pushes="" if sockets is None else sockets.pushes,
                answers="" if sockets is None else sockets.answers,
            )
            return asyncio.run(_compare(bus, plan, sockets, repeats, said))
    finally:
        if sockets is not None:
            sockets.close()


async def _compare(
    bus: LocalBus, plan: BusPlan, sockets: ZmqSockets | None, repeats: int, said: Callable[[str], object]
) -> BusTimes:
    transport = ZenohTransport(bus.first())
    session = bare_session(listen=(plan.bare_endpoint,))
    try:
        with far_process("parts.bus_far_end", msgspec.json.encode(plan)) as far:
            near = NearEnd(plan, transport, session, sockets)
            calls = await send_all(near, plan, transport, repeats, said)
            one_way = msgspec.json.decode(await asyncio.to_thread(result_of, far), type=list[Delay])
    finally:
        await asyncio.to_thread(session.close)
        await transport.close()
    return BusTimes(one_way, calls)


@contextmanager
def far_process(module: str, plan: bytes) -> Generator["subprocess.Popen[bytes]"]:
    """Start a module of this folder as a process, which has read its plan and is ready; it is killed at the end."""
    command = (sys.executable, "-m", module)
    with subprocess.Popen(command, cwd=FOLDER, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(plan + b"\n")
            process.stdin.flush()
            if process.stdout.readline() != READY:
                raise MachineError("the process at the far end did not start; its error is above")
            yield process
        finally:
            process.kill()


def result_of(process: "subprocess.Popen[bytes]") -> bytes:
    """Close the input of a process and return its output."""
    said, _ = process.communicate(timeout=FAR_END_S)
    return said


def _pyzmq() -> ModuleType | None:
    try:
        return importlib.import_module("zmq")
    except ImportError:
        return None
