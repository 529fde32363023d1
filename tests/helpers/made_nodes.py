"""The node of a ROS 2 workspace, as dlokit's half of the link meets it, without ROS and without a socket."""

import asyncio
import os
import struct
from typing import cast

from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink

HELLO = frames.Hello(
    version=frames.VERSION,
    distribution="jazzy",
    rmw="rmw_fastrtps_cpp",
    node="/dlokit",
    package="0.1.0",
    hashes={},
)


class _Socket:
    def __init__(self, user: int) -> None:
        self._user = user

    def getsockopt(self, level: int, option: int, size: int) -> bytes:
        return struct.pack("3i", 1, self._user, 1)


class _Transport:
    waiting = 0

    def get_write_buffer_size(self) -> int:
        return self.waiting


class NodePeer:
    """A node at the link, in place of a socket: what it sends, and what it got."""

    def __init__(self, user: int | None = None) -> None:
        self.reader = asyncio.StreamReader()
        self.transport = _Transport()
        self._socket = _Socket(os.getuid() if user is None else user)
        self._got = bytearray()
        self.closed = False

    def send(self, *headers: frames.FromNode | frames.ToNode) -> None:
        for header in headers:
            self.send_message(header)

    def send_message(self, header: frames.FromNode | frames.ToNode, payload: bytes = b"") -> None:
        self.reader.feed_data(frames.encode(header, payload))

    async def served_by(self, link: NodeLink) -> None:
        await link.serve(self.reader, cast(asyncio.StreamWriter, self))

    def write(self, data: bytes) -> None:
        self._got += data

    def close(self) -> None:
        self.closed = True

    def is_closing(self) -> bool:
        return self.closed

    def get_extra_info(self, name: str) -> _Socket:
        return self._socket

    async def got(self) -> list[frames.FromNode | frames.ToNode]:
        reader = asyncio.StreamReader()
        reader.feed_data(bytes(self._got))
        reader.feed_eof()
        found: list[frames.FromNode | frames.ToNode] = []
        while True:
            try:
                found.append((await frames.read(reader))[0])
            except EOFError:
                return found

    async def refused(self) -> str:
        (answer,) = [one for one in await self.got() if isinstance(one, frames.Refused)]
        return answer.why
