"""The Unix socket at which the node of a ROS 2 workspace connects, one node at a time.

Either side may start first, die and come back. A peer that is silent for `SILENT_S` counts as dead.
"""

import asyncio
import contextlib
import logging
import os
import pwd
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from dlokit import __version__
from dlokit.communication.container import end_tasks
from dlokit.communication.log_rate import LogRate
from dlokit.errors import CommunicationError, ConfigError, MachineError
from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.extras.ros2.link import frames
from dlokit.system.processes.runtime_folder import LONGEST_SOCKET, RUNTIME_DIR, private_folder, user_folder
from dlokit.system.processes.sockets import peer_of

log = logging.getLogger(__name__)

NODE_WITHIN_S = 10.0
"""Longest wait for a node where a run needs one [s]; a running node looks for the socket five times a second."""
START_NODE = (
    "`ros2 run dlokit_ros bridge`, or `python3 -m dlokit_ros.bridge`, in a terminal with your workspace sourced"
)
_NOTICE_S = 1.0
"""A wait that is longer is said [s]; a running node connects in a fifth of a second."""
BEAT_S = 1.0
SILENT_S = 3.0
_HELLO_WITHIN_S = 2.0
_MOST_WAITING = 2**25
"""Bytes that may wait for a node that does not read; further messages are dropped, and the newest counts later."""


def link_socket(name: str) -> Path:
    """Path of the socket of a link. Raises `ConfigError` for a bad name, `MachineError` for a path that is too long."""
    if not name or not name.replace("_", "").replace("-", "").isalnum():
        raise ConfigError(f"--ros2.link is {name!r}; it must be letters, digits, - and _, as its socket is called so.")
    path = private_folder(user_folder() / "ros2") / f"{name}.sock"
    if len(os.fsencode(path)) > LONGEST_SOCKET:
        raise MachineError(f"{path} is too long for a socket: set {RUNTIME_DIR} to a shorter folder.")
    return path


class NodeLink:
    """The connection to the node, if one is there."""

    def __init__(
        self,
        joined: Callable[[frames.Hello], None],
        heard: Callable[[frames.FromNode, bytes], None],
        silent_s: float = SILENT_S,
    ) -> None:
        """`joined` is called for each node that connects, `heard` with each of its frames, on the event loop."""
        self.node: frames.Hello | None = None
        """The node that is connected; None: there is none."""
        self.clocks: frames.Time | None = None
        """Its clocks, at most a second old."""
        self.graph: frames.Graph | None = None
        """What it sees of the ROS graph, at most a second old; None before it has said so."""
        self.lacks: dict[str, str] = {}
        """Why it cannot publish or subscribe to a topic, by topic."""
        self.dropped = 0
        """Messages that the node did not read in time."""
        self._joined, self._heard = joined, heard
        self._silent_s = silent_s
        self._writer: asyncio.StreamWriter | None = None
        self._refusals = LogRate()
        self._present = asyncio.Event()

    @property
    def definitions(self) -> Definitions:
        """The definitions of the node's distribution."""
        assert self.node is not None, "no node is connected"
        return definitions_of(self.node.distribution)

    def send(self, header: frames.ToNode, payload: bytes = b"") -> None:
        """Send a frame; without a node it is dropped, and also where the node does not read."""
        if self._writer is None or self._writer.is_closing():
            return
        if self._writer.transport.get_write_buffer_size() > _MOST_WAITING:
            self.dropped += 1
            return
        self._writer.write(frames.encode(header, payload))

    async def wait_node(self, within_s: float) -> frames.Hello | None:
        """The node, for which it waits at most `within_s` [s]; None: there is none."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._present.wait()
        return self.node

    async def require_node(self) -> None:
        """Wait for a node, and say so where that takes more than a moment. Raises `ConfigError` when there is none."""
        if await self.wait_node(_NOTICE_S) is None:
            log.warning("waiting for a node of a ROS 2 workspace, at most %g s: %s", NODE_WITHIN_S, START_NODE)
            if await self.wait_node(NODE_WITHIN_S - _NOTICE_S) is None:
                raise ConfigError(
                    f"no node of a ROS 2 workspace has connected within {NODE_WITHIN_S:g} s: start it with {START_NODE}"
                )

    def ros_now_ns(self) -> int | None:
        """ROS time now [ns]; None before the node has sent its clocks."""
        if self.clocks is None:
            return None
        return self.clocks.ros_ns + time.monotonic_ns() - self.clocks.monotonic_ns

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one peer until it leaves, is silent, or is refused."""
        hello = await self._introduced(reader, writer)
        if hello is not None:
            await self._follow(hello, reader, writer)

    async def _introduced(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> frames.Hello | None:
        """The first frame of a node; None for a peer that was refused or has left."""
        try:
            async with asyncio.timeout(_HELLO_WITHIN_S):
                hello, _ = await frames.read(reader)
        except (EOFError, OSError):
            return None  # another run looks whether the link is taken
        except (CommunicationError, TimeoutError) as error:
            self._refuse(f"it does not introduce itself as a node of dlokit: {error or 'no frame'}", writer)
            return None
        if why := self._flaw_of(hello, writer):
            self._refuse(why, writer)
            return None
        assert isinstance(hello, frames.Hello), "anything else is a flaw"
        return hello

    def _flaw_of(self, hello: object, writer: asyncio.StreamWriter) -> str:
        """Why a peer is refused; empty: it is not."""
        peer = peer_of(writer.get_extra_info("socket"))
        if peer is not None and peer.user != os.getuid():
            return (
                f"it runs as user {_name_of(peer.user)}, dlokit as {_name_of(os.getuid())}: start both as the same "
                f"user; in a container with `--user {os.getuid()}`"
            )
        if not isinstance(hello, frames.Hello):
            return f"its first frame is {type(hello).__name__}; it must be Hello"
        if hello.version != frames.VERSION:
            return (
                f"its package dlokit_ros {hello.package} has version {hello.version} of the link, this dlokit "
                f"{frames.VERSION}: install the package that belongs to dlokit {__version__}"
            )
        if self.node is not None:
            return f"the node {self.node.node} is connected already: end one of them, or give it a link of its own"
        try:
            definitions_of(hello.distribution)
        except ConfigError as error:
            return str(error)
        return ""

    def _refuse(self, why: str, writer: asyncio.StreamWriter) -> None:
        if number := self._refusals.due("refused"):
            log.warning("ROS 2: a peer was refused (%d so far): %s", number, why)
        with contextlib.suppress(OSError):
            writer.write(frames.encode(frames.Refused(why=why)))
        writer.close()

    async def _follow(self, hello: frames.Hello, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.node, self._writer = hello, writer
        log.info("ROS 2: node %s of %s with %s is connected", hello.node, hello.distribution, hello.rmw)
        self.send(frames.Welcome(version=frames.VERSION, dlokit=__version__))
        beats = asyncio.create_task(self._beats(), name="ros2 beats")
        try:
            self._joined(hello)
            self._present.set()
            while True:
                async with asyncio.timeout(self._silent_s):
                    header, payload = await frames.read(reader)
                if isinstance(header, frames.ToNode):
                    raise CommunicationError(f"a node does not send {type(header).__name__}")
                self._note(header)
                self._heard(header, payload)
        except EOFError:
            log.warning("ROS 2: node %s has left", hello.node)
        except TimeoutError:
            log.warning("ROS 2: node %s was silent for %g s: the link is closed", hello.node, self._silent_s)
        except (CommunicationError, OSError) as error:
            log.warning("ROS 2: node %s sent what cannot be read: %s; the link is closed", hello.node, error)
        finally:
            self.node = self.clocks = self.graph = self._writer = None
            self.lacks = {}
            self._present.clear()
            writer.close()
            await end_tasks(beats)

    def _note(self, header: frames.FromNode) -> None:
        match header:
            case frames.Time():
                self.clocks = header
            case frames.Graph():
                self.graph = header
            case frames.Lacks():
                self.lacks[header.topic] = header.why
            case _:
                pass

    async def _beats(self) -> None:
        while True:
            self.send(frames.Beat(real_ns=time.time_ns(), monotonic_ns=time.monotonic_ns()))
            await asyncio.sleep(BEAT_S)


@asynccontextmanager
async def listening(link: NodeLink, path: Path) -> AsyncGenerator[None]:
    """Serve a link at a socket while the context is open.

    Raises `ConfigError` when another run of dlokit serves it, `MachineError` when it cannot be made.
    """
    if await _is_served(path):
        raise ConfigError(
            f"the link {path.stem} serves another run of dlokit: end that run, or give this one another name, with "
            f"--ros2.link here and `link` at the node."
        )
    _remove(path)  # left by a killed process
    peers = set[asyncio.Task[None]]()

    def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = asyncio.create_task(link.serve(reader, writer), name="ros2 peer")
        peers.add(peer)
        peer.add_done_callback(peers.discard)
        peer.add_done_callback(lambda _: writer.close())

    try:
        server = await asyncio.start_unix_server(serve, path)
    except OSError as error:
        raise MachineError(f"{path} cannot be made: {error}; set {RUNTIME_DIR} to a folder of yours.") from error
    try:
        yield
    finally:
        server.close()
        await end_tasks(*peers)
        _remove(path)


def _remove(path: Path) -> None:
    path.unlink(missing_ok=True)


async def _is_served(path: Path) -> bool:
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except OSError:
        return False
    writer.close()
    return True


def _name_of(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)
