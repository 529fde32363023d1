"""The link to the node of a ROS 2 workspace: who is admitted, and what ends it."""

import asyncio
import os
from collections.abc import Coroutine
from typing import Any

import msgspec
import pytest
from made_nodes import HELLO, NodePeer

from dlokit.communication.timing import virtual_time
from dlokit.errors import ConfigError
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NODE_WITHIN_S, SILENT_S, NodeLink, link_socket


class Heard:
    """What a link reports."""

    def __init__(self) -> None:
        self.joined: list[frames.Hello] = []
        self.frames: list[frames.FromNode] = []
        self.link = NodeLink(self.joined.append, lambda header, payload: self.frames.append(header))

    def serve(self, peer: NodePeer) -> Coroutine[Any, Any, None]:
        return peer.served_by(self.link)


def run(main: Coroutine[Any, Any, None]) -> None:
    virtual_time.run(main)


@pytest.mark.parametrize(
    ("hello", "says"),
    [
        (msgspec.structs.replace(HELLO, version=99), "version 99 of the link"),
        (msgspec.structs.replace(HELLO, distribution="foxy"), "'foxy' is not known; known are humble, jazzy"),
        (frames.Time(ros_ns=0, monotonic_ns=0), "first frame is Time"),
    ],
)
def test_a_peer_that_is_no_fitting_node_is_refused_with_the_reason(hello: frames.FromNode, says: str):
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.send(hello)
        await heard.serve(peer)
        assert says in await peer.refused()
        assert peer.closed
        assert not heard.joined

    run(main())


def test_garbage_is_refused():
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.reader.feed_data(b"GET / HTTP/1.1\r\n\r\n")
        await heard.serve(peer)
        assert "does not introduce itself" in await peer.refused()
        assert peer.closed

    run(main())


def test_a_node_of_another_user_is_refused_by_name():
    async def main() -> None:
        heard, peer = Heard(), NodePeer(user=12345)
        peer.send(HELLO)
        await heard.serve(peer)
        assert "runs as user 12345" in await peer.refused()
        assert f"--user {os.getuid()}" in await peer.refused()

    run(main())


def test_a_second_node_is_refused_while_the_first_is_connected():
    async def main() -> None:
        heard, first, second = Heard(), NodePeer(), NodePeer()
        first.send(HELLO)
        second.send(msgspec.structs.replace(HELLO, node="/other/dlokit"))
        serving = asyncio.create_task(heard.serve(first))
        assert await heard.link.wait_node(1.0) == HELLO
        await heard.serve(second)
        assert "the node /dlokit is connected already" in await second.refused()
        assert heard.link.node == HELLO
        first.reader.feed_eof()
        await serving

    run(main())


def test_a_node_that_has_left_may_come_back():
    async def main() -> None:
        heard = Heard()
        for _ in range(2):
            peer = NodePeer()
            peer.send(HELLO)
            peer.reader.feed_eof()
            await heard.serve(peer)
            assert heard.link.node is None
        assert heard.joined == [HELLO, HELLO]

    run(main())


def test_a_silent_node_counts_as_dead():
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.send(HELLO)
        begin_s = asyncio.get_running_loop().time()
        await heard.serve(peer)
        assert asyncio.get_running_loop().time() - begin_s == pytest.approx(SILENT_S)
        assert peer.closed
        assert heard.link.node is None

    run(main())


def test_a_node_gets_a_welcome_and_then_a_heartbeat_each_second():
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.send(HELLO)
        await heard.serve(peer)
        welcome, *beats = await peer.got()
        assert isinstance(welcome, frames.Welcome)
        assert len(beats) == SILENT_S
        assert all(isinstance(beat, frames.Beat) for beat in beats)

    run(main())


def test_messages_that_the_node_does_not_read_are_dropped_and_counted():
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.send(HELLO)
        serving = asyncio.create_task(heard.serve(peer))
        await heard.link.wait_node(1.0)
        peer.transport.waiting = 2**30
        heard.link.send(frames.Publish(topic="~/dlo"), b"x")
        assert heard.link.dropped == 1
        peer.transport.waiting = 0
        heard.link.send(frames.Publish(topic="~/goal"), b"x")
        peer.reader.feed_eof()
        await serving
        assert [one.topic for one in await peer.got() if isinstance(one, frames.Publish)] == ["~/goal"]

    run(main())


def test_frames_that_only_dlokit_sends_end_the_link():
    async def main() -> None:
        heard, peer = Heard(), NodePeer()
        peer.send(HELLO, frames.Publish(topic="~/dlo"))
        await heard.serve(peer)
        assert heard.link.node is None
        assert not heard.frames

    run(main())


def test_where_no_node_comes_within_ten_seconds_the_command_to_start_it_is_named(caplog: pytest.LogCaptureFixture):
    async def main() -> None:
        begin_s = asyncio.get_running_loop().time()
        with pytest.raises(ConfigError, match=r"within 10 s: start it with `ros2 run dlokit_ros bridge`"):
            await Heard().link.require_node()
        assert asyncio.get_running_loop().time() - begin_s == pytest.approx(NODE_WITHIN_S)

    run(main())
    assert "waiting for a node" in caplog.text


@pytest.mark.parametrize("name", ["", "../stop", "a b", "a/b"])
def test_the_name_of_a_link_is_no_path(name: str):
    with pytest.raises(ConfigError, match="letters, digits"):
        link_socket(name)
