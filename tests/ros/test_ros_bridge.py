"""The node in a workspace, between real nodes and dlokit's half of the link."""

import os
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest
from live_systems import Background, background, eventually
from ros_lab import HANGS_S, RosNetwork

from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink, link_socket, listening
from dlokit.system.processes.stop_socket import CONFIRMED_STOP, stop_button, stop_socket

RUNTIME = Path(os.environ["DLOKIT_RUNTIME_DIR"])
IMAGE, STATUS = "sensor_msgs/msg/Image", "diagnostic_msgs/msg/DiagnosticStatus"


class Peer:
    """dlokit's half of the link, on a loop of its own."""

    def __init__(self, loop: Background) -> None:
        self.loop = loop
        self.nodes = list[frames.Hello]()
        self.heard = list[tuple[frames.FromNode, bytes]]()
        self.link = NodeLink(self.nodes.append, lambda header, payload: self.heard.append((header, payload)))

    def send(self, header: frames.ToNode, payload: bytes = b"") -> None:
        async def on_loop() -> None:
            self.link.send(header, payload)

        self.loop.run(on_loop())

    def until(self, condition: Callable[[], bool]) -> None:
        self.loop.run(eventually(condition))

    @property
    def received(self) -> list[tuple[frames.RosMessage, bytes]]:
        return [(header, cdr) for header, cdr in self.heard if isinstance(header, frames.RosMessage)]


@pytest.fixture
def peer() -> Generator[Peer]:
    with background() as loop:
        peer = Peer(loop)
        with loop.entered(listening(peer.link, link_socket("dlokit"))):
            yield peer


@pytest.mark.smoke
def test_a_picture_of_the_lab_reaches_dlokit_and_a_late_subscriber_gets_what_dlokit_has_said(
    lab: RosNetwork, peer: Peer
) -> None:
    lab.bridge(RUNTIME)
    peer.until(lambda: len(peer.nodes) == 1)
    assert peer.nodes[0].distribution == lab.environment.distribution
    assert peer.nodes[0].rmw == "rmw_fastrtps_cpp"
    definitions = peer.link.definitions
    status = definitions.make(STATUS, level=0, name="dlokit", message="converged", hardware_id="", values=[])
    peer.send(frames.Advertise(topic="~/status", type=STATUS, transient_local=True))
    peer.send(frames.Publish(topic="~/status"), definitions.encode(STATUS, status))

    camera = lab.camera()
    camera.order("topic", topic="/colour", type=IMAGE, reliable=False)
    peer.send(frames.Subscribe(topic="/colour", type=IMAGE))
    camera.order("await", topic="/colour", count=1)
    camera.hear("matched")
    pixels = np.arange(4 * 6 * 3, dtype=np.uint8)
    shape = {"stamp_ns": 12_000_000_034, "frame": "optical", "width": 6, "height": 4, "encoding": "rgb8", "step": 18}
    camera.order("image", pixels.tobytes(), topic="/colour", **shape)

    peer.until(lambda: len(peer.received) == 1)
    picture = definitions.decode(IMAGE, peer.received[0][1])
    assert (picture.header.stamp.sec, picture.header.stamp.nanosec, picture.encoding) == (12, 34, "rgb8")
    np.testing.assert_array_equal(picture.data, pixels)
    late = lab.listener()
    late.order("subscribe", topic="/dlokit/status", type=STATUS, transient_local=True, depth=1)
    assert late.hear("message")["fields"]["message"] == "converged"


@pytest.mark.smoke
def test_the_stop_service_presses_the_stop_of_a_robot_without_any_link(lab: RosNetwork, tmp_path: Path) -> None:
    lab.bridge(RUNTIME)
    caller, orders = lab.listener(), list[str]()

    async def stop(caller: object) -> None:
        orders.append("stop")

    async def enable() -> None:
        orders.append("enable")

    with background() as loop, loop.entered(stop_button(stop_socket(tmp_path, ""), stop, enable)):
        caller.order("call", service="/dlokit/stop", within_s=HANGS_S)
        answer = caller.hear("called")
    assert answer["success"], answer
    assert CONFIRMED_STOP in answer["message"]
    assert orders == ["stop"]
    caller.order("call", service="/dlokit/stop", within_s=HANGS_S)
    assert caller.hear("called")["success"] is False


def test_either_side_dies_and_comes_back(lab: RosNetwork) -> None:
    node, _ = lab.bridge(RUNTIME)
    with background() as loop:
        peer = Peer(loop)
        with loop.entered(listening(peer.link, link_socket("dlokit"))):
            peer.until(lambda: len(peer.nodes) == 1)
        with loop.entered(listening(peer.link, link_socket("dlokit"))):
            peer.until(lambda: len(peer.nodes) == 2)
            node.kill()
            peer.until(lambda: peer.link.node is None)
            lab.bridge(RUNTIME)
            peer.until(lambda: len(peer.nodes) == 3)
