"""Two processes, the one that sends and the one that receives, and what both have measured."""

import asyncio
import importlib
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from uuid import uuid4

import msgspec

from dlokit.bench.bus.far_end import READY
from dlokit.bench.bus.load import SIZES_BYTES, BusPlan, Delay, bare_session
from dlokit.bench.bus.near_end import NearEnd, ZmqSockets, send_all
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import MachineError

FAR_END_S = 60.0
"""For the other process to end and to tell what it has measured."""


@dataclass(frozen=True)
class BusTimes:
    """Seconds under way."""

    one_way: list[Delay]
    """From handing a message over to its reader having it; each method in its own thread or coroutine."""
    calls: list[Delay]
    """From asking to having the answer."""


def compare(repeats: int, sizes: tuple[int, ...] = SIZES_BYTES) -> BusTimes:
    """Send `repeats` messages and calls of each size with each method. pyzmq is left out where it is not installed."""
    zmq = _pyzmq()
    sockets = None if zmq is None else ZmqSockets(zmq)
    plan = BusPlan(
        namespace=f"dlokit_bench/{uuid4().hex}",
        endpoint=free_endpoint(),
        bare_endpoint=free_endpoint(),
        pushes="" if sockets is None else sockets.pushes,
        answers="" if sockets is None else sockets.answers,
        sizes=sizes,
    )
    try:
        return asyncio.run(_compare(plan, sockets, repeats))
    finally:
        if sockets is not None:
            sockets.close()


async def _compare(plan: BusPlan, sockets: ZmqSockets | None, repeats: int) -> BusTimes:
    transport = ZenohTransport(ZenohConfig(namespace=plan.namespace, listen=(plan.endpoint,)))
    session = bare_session(listen=(plan.bare_endpoint,))
    try:
        with far_process("dlokit.bench.bus.far_end", msgspec.json.encode(plan)) as far:
            near = NearEnd(plan, transport, session, sockets)
            calls = await send_all(near, plan, transport, repeats)
            one_way = msgspec.json.decode(await asyncio.to_thread(result_of, far), type=list[Delay])
    finally:
        await asyncio.to_thread(session.close)
        await transport.close()
    return BusTimes(one_way, calls)


@contextmanager
def far_process(module: str, plan: bytes) -> Generator["subprocess.Popen[bytes]"]:
    """A process of this interpreter that has read its plan and is ready; killed at the end."""
    with subprocess.Popen((sys.executable, "-m", module), stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
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
    """What a process says once its input has ended."""
    said, _ = process.communicate(timeout=FAR_END_S)
    return said


def free_endpoint() -> str:
    """Where a session of the loopback interface may listen."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _pyzmq() -> ModuleType | None:
    try:
        return importlib.import_module("zmq")
    except ImportError:
        return None
