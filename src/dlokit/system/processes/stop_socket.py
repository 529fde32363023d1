"""The stop socket of a robot's process, which works without any other process.

The bus of a system runs through the decision process. An operator's stop must reach the arm even when that process is
frozen or dead, so each robot process listens on a socket in the user's folder (mode 0700). While a system
starts, a stop is stored as a file beside the socket, which the robot process reads when it starts.
"""

import asyncio
import contextlib
import socket as sockets
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Protocol

import msgspec

from dlokit.errors import DlokitError, MachineError
from dlokit.system.processes.first_press import STOP
from dlokit.system.processes.runtime_folder import LONGEST_SOCKET, RUNTIME_DIR, sockets_begin_with, user_folder
from dlokit.system.processes.sockets import peer_of
from dlokit.types.robot import FIRST_ROBOT

ENABLE = b"enable\n"
CONFIRMED_STOP = "stands, and is stopped until dlokit enable"
"""Answer of a robot's process to a stop that feedback has confirmed."""
_ORDER_WITHIN_S = 1.0  # time for a caller to send its order
_RETRY_S = 0.05
_LONGEST_COMMAND = 100  # characters of a command line in messages


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of a robot's process to an order."""

    confirmed: bool
    """Whether feedback of the arm confirms that the order was executed."""
    text: str


def stop_socket(run_dir: Path, instance: str) -> Path:
    """Socket path of a robot of a run, by its address on the bus.

    Raises `MachineError` when the path is too long for a socket.
    """
    path = user_folder() / f"{sockets_begin_with(run_dir)}{instance or FIRST_ROBOT}.stop"
    if len(str(path).encode()) > LONGEST_SOCKET:
        raise MachineError(
            f"{path} is longer than the {LONGEST_SOCKET} bytes allowed for a socket: "
            f"set {RUNTIME_DIR} to a shorter folder."
        )
    return path


def stop_at_start_file(socket: Path) -> Path:
    """The file that makes a robot process start in the stopped state."""
    return socket.with_suffix(".stopped")


@asynccontextmanager
async def stop_button(
    socket: Path, stop: Callable[[Callable[[], str]], Awaitable[None]], enable: Callable[[], Awaitable[None]]
) -> AsyncGenerator[None]:
    """Serve the socket; each order is answered after its execution, or with the cause of its failure.

    `stop` receives a function that returns which process asked, to be called after the brake. `stop` and
    `enable` raise `DlokitError` if feedback does not confirm them.
    """

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, TimeoutError, ValueError), contextlib.closing(writer):
            async with asyncio.timeout(_ORDER_WITHIN_S):
                order = await reader.readline()
            caller = partial(caller_of, writer.get_extra_info("socket"))
            answer = await _answer(order, socket, partial(stop, caller), enable)
            writer.write(msgspec.json.encode(answer) + b"\n")
            await writer.drain()

    _remove(socket)  # left by a killed process
    server = await asyncio.start_unix_server(serve, socket)
    try:
        if _is_left(socket):
            await stop(lambda: "dlokit stop, while the system started")
        yield
    finally:
        server.close()
        _remove(socket)
        _remove(stop_at_start_file(socket))


def _remove(path: Path) -> None:
    path.unlink(missing_ok=True)


def _is_left(socket: Path) -> bool:
    return stop_at_start_file(socket).exists()


async def _answer(
    order: bytes, socket: Path, stop: Callable[[], Awaitable[None]], enable: Callable[[], Awaitable[None]]
) -> Answer:
    try:
        if order == STOP:
            await stop()
            return Answer(confirmed=True, text=CONFIRMED_STOP)
        if order == ENABLE:
            _remove(stop_at_start_file(socket))
            await enable()
            return Answer(confirmed=True, text="is enabled")
    except DlokitError as error:
        return Answer(confirmed=False, text=str(error))
    return Answer(confirmed=False, text=f"{order!r} is not an order; use {STOP!r} or {ENABLE!r}")


def caller_of(link: sockets.socket) -> str:
    """The process at the other end of a Unix socket, e.g. ``process 4711 (dlokit stop)``, as far as it is known."""
    peer = peer_of(link)
    return "another process" if peer is None else process_named(peer.pid)


def process_named(pid: int) -> str:
    """A process by its number and command; it may have ended, or be in another container (number 0)."""
    if pid <= 0:
        return "a process of another container"
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").rstrip("\0").split("\0")
    except OSError:
        words = list[str]()
    if len(words) > 1 and Path(words[0]).name.startswith("python") and not words[1].startswith("-"):
        del words[0]  # the interpreter of a script
    words[:1] = [Path(word).name for word in words[:1]]
    command = "".join(letter if letter.isprintable() else " " for letter in " ".join(words))  # it goes to terminals
    return f"process {pid} ({command[:_LONGEST_COMMAND]})" if command else f"process {pid}"


class PressStop(Protocol):
    """A function that sends an order to a robot's process, as `press` does."""

    async def __call__(self, socket: Path, order: bytes, within_s: float, *, starts: bool = False) -> Answer | None:
        """None if none listens."""
        ...


async def press(socket: Path, order: bytes, within_s: float, *, starts: bool = False) -> Answer | None:
    """Send an order to a robot's process; None if none listens, for one that `starts` within `within_s` [s]."""
    try:
        async with asyncio.timeout(within_s):
            while True:
                try:
                    reader, writer = await asyncio.open_unix_connection(socket)
                    break
                except (FileNotFoundError, ConnectionRefusedError):
                    if not starts:
                        return None
                    await asyncio.sleep(_RETRY_S)
    except TimeoutError:
        return None
    try:
        async with asyncio.timeout(within_s):
            writer.write(order)
            await writer.drain()
            line = await reader.readline()
        return msgspec.json.decode(line, type=Answer)
    except (TimeoutError, OSError, msgspec.DecodeError):
        return _no_answer(within_s)
    finally:
        writer.close()


async def answer_on(link: sockets.socket, within_s: float) -> Answer | None:
    """The answer to an order that was sent over `link`, which is closed; None if the process closed it before."""
    reader, writer = await asyncio.open_unix_connection(sock=link)
    try:
        async with asyncio.timeout(within_s):
            line = await reader.readline()
        return msgspec.json.decode(line, type=Answer) if line else None
    except ConnectionError:
        return None
    except (TimeoutError, msgspec.DecodeError):
        return _no_answer(within_s)
    finally:
        writer.close()


def _no_answer(within_s: float) -> Answer:
    return Answer(confirmed=False, text=f"its process did not answer within {within_s:g} s")
