"""The camera of a run in ROS 2: its pictures, stamps and pose, and what is said where there are none."""

import asyncio
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import ros2_messages as ros
from made_nodes import HELLO
from ros2_messages import cdr

from dlokit import geometry
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock
from dlokit.errors import ClockJumped, HardwareError
from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink
from dlokit.extras.ros2.pictures.sight import PictureClock, RosSight
from dlokit.extras.ros2.pictures.transforms import TF_STATIC
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.system.config import RunConfig
from dlokit.types.image import CameraCalibration, DepthImage

COLOUR, DEPTH, INFO = "/camera/color/image_raw", "/camera/depth/image_raw", "/camera/color/camera_info"
T_BASE_CAMERA = geometry.pose((0.5, 0.1, 0.9), (0.0, 1.0, 0.0, 0.0))
CAMERA = CameraCalibration(
    width_px=8, height_px=6, fx_px=10.0, fy_px=10.0, cx_px=3.5, cy_px=2.5, T_world_camera=T_BASE_CAMERA
)
TOPICS = Ros2CameraConfig(colour=COLOUR, depth=DEPTH)
GRAPH = frames.Graph(
    topics={COLOUR: [ros.IMAGE], DEPTH: [ros.IMAGE], INFO: [ros.INFO]}, publishers={}, subscriptions={}
)
PERIOD_NS = 33_000_000
SINCE_1970_NS = 1_800_000_000_000_000_000
LATE_NS = 20_000_000


class HandClock:
    """The machine's clock, that of the run, and ROS time, which a test sets."""

    def __init__(self) -> None:
        self.time_ns = 1_000_000_000

    def now_ns(self) -> int:
        return self.time_ns

    def ros_ns(self) -> int:
        return self.time_ns + SINCE_1970_NS


class FakeLink:
    """A link whose node sends what a test says."""

    def __init__(self, clock: HandClock) -> None:
        self.node: frames.Hello | None = HELLO
        self.sent: list[frames.ToNode] = []
        self.graph: frames.Graph | None = None
        self.lacks: dict[str, str] = {}
        self._clock = clock

    @property
    def definitions(self) -> Definitions:
        return definitions_of("jazzy")

    def send(self, header: frames.ToNode, payload: bytes = b"") -> None:
        self.sent.append(header)

    def ros_now_ns(self) -> int | None:
        return self._clock.ros_ns()


class Node:
    """The node, as a camera of the run sees it."""

    def __init__(self, run: RunConfig | None = None, topics: Ros2CameraConfig = TOPICS) -> None:
        self.clock = HandClock()
        self.link = FakeLink(self.clock)
        link, clock = cast(NodeLink, self.link), cast(Clock, self.clock)
        self.sight = RosSight(run or RunConfig(), topics, link, clock, self.clock.now_ns)
        self.sight.joined()

    def says(self, header: frames.FromNode, payload: bytes = b"") -> None:
        match header:  # as the link notes it
            case frames.Graph():
                self.link.graph = header
            case frames.Lacks():
                self.link.lacks[header.topic] = header.why
            case _:
                pass
        self.sight.heard(header, payload)

    def publishes(self, topic: str, message: Any) -> None:
        header = frames.RosMessage(topic=topic, type=message.__msgtype__, arrived_ns=self.clock.time_ns)
        self.says(header, cdr(message))

    def places(self, parent: str = "base_link", child: str = "camera") -> None:
        self.publishes(TF_STATIC, ros.tf((parent, child, T_BASE_CAMERA)))

    def shows(self, stamp_ns: int) -> None:
        colour, depth = np.full((6, 8, 3), 50, np.uint8), np.full((6, 8), 700, np.uint16)
        self.publishes(INFO, ros.info(CAMERA, stamp_ns=stamp_ns))
        self.publishes(COLOUR, ros.image(colour, "rgb8", stamp_ns=stamp_ns))
        self.publishes(DEPTH, ros.image(depth, "16UC1", stamp_ns=stamp_ns))


async def capturing(node: Node, *after_ns: int) -> DepthImage:
    """The next pictures while some arrive that were exposed this long after the call [ns], 20 ms before."""
    coming = asyncio.create_task(node.sight.next(1.0))
    await asyncio.sleep(0)
    asked_ns = node.clock.time_ns
    for one_ns in after_ns:
        node.clock.time_ns = max(node.clock.time_ns, asked_ns + one_ns + LATE_NS)
        node.shows(asked_ns + one_ns + SINCE_1970_NS)
    found = await coming
    assert isinstance(found, DepthImage)
    assert found.stamp_ns == asked_ns + after_ns[-1]
    return found


def captured(node: Node, *after_ns: int) -> DepthImage:
    """As `capturing`, once a test."""
    return virtual_time.run(capturing(node, *after_ns))


def refused(node: Node) -> str:
    """Why there are no pictures."""
    with pytest.raises(HardwareError) as error:
        virtual_time.run(node.sight.next(1.0))
    return str(error.value)


def test_pictures_come_with_calibration_and_the_pose_in_tf() -> None:
    node = Node()
    node.places()
    found = captured(node, PERIOD_NS)
    assert found.depth_m == pytest.approx(np.full((6, 8), 0.7))
    assert found.calibration.fx_px == CAMERA.fx_px
    assert found.calibration.T_world_camera.position_m == pytest.approx(T_BASE_CAMERA.position_m)


def test_the_base_of_the_first_arm_is_where_the_installation_says() -> None:
    run = RunConfig()
    first = replace(run.installation.arms[0], position_m=(0.0, 0.0, 0.2))
    node = Node(replace(run, installation=replace(run.installation, arms=(first,))))
    node.places()
    found = captured(node, PERIOD_NS)
    assert found.calibration.T_world_camera.position_m == pytest.approx([0.5, 0.1, 1.1])


def test_of_a_file_and_tf_the_file_counts_and_the_difference_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "calibration.toml"
    write_calibration(file, replace_pose(CAMERA, 0.012))
    node = Node(topics=replace(TOPICS, calibration=str(file)))
    node.places()
    found = captured(node, PERIOD_NS)
    assert found.calibration.T_world_camera.position_m == pytest.approx([0.512, 0.1, 0.9])
    assert "12.0 mm and 0.00°" in caplog.text


def replace_pose(camera: CameraCalibration, by_m: float) -> CameraCalibration:
    x, y, z = camera.T_world_camera.position_m
    moved = geometry.pose((x + by_m, y, z), camera.T_world_camera.wxyz)
    return CameraCalibration(
        width_px=8, height_px=6, fx_px=10.0, fy_px=10.0, cx_px=3.5, cy_px=2.5, T_world_camera=moved
    )


def test_a_picture_from_before_the_call_is_not_taken() -> None:
    node = Node()
    node.places()
    captured(node, -LATE_NS, PERIOD_NS)


def test_a_jump_of_the_cameras_clock_is_named_and_the_next_pictures_are_good() -> None:
    async def main() -> None:
        node = Node()
        node.places()
        await capturing(node, PERIOD_NS)
        coming = asyncio.create_task(node.sight.next(1.0))
        await asyncio.sleep(0)
        node.shows(node.clock.ros_ns() + 1_000_000_000)
        with pytest.raises(ClockJumped, match=r"jumped by \+1\.\d+ s"):
            await coming
        node.clock.time_ns += 1_000_000_000
        await capturing(node, 2 * PERIOD_NS, 3 * PERIOD_NS)

    virtual_time.run(main())


def test_without_a_chain_in_tf_the_two_trees_are_named() -> None:
    node = Node()
    node.places("map", "camera")
    with pytest.raises(HardwareError, match=r"base_link.*map"):
        captured(node, PERIOD_NS)


def test_the_camera_subscribes_to_its_topics_with_the_types_that_are_published() -> None:
    node = Node()
    graph = frames.Graph(topics={**GRAPH.topics, COLOUR: [ros.COMPRESSED]}, publishers={}, subscriptions={})
    node.says(graph)
    node.says(graph)
    wanted = [(one.topic, one.type) for one in node.link.sent if isinstance(one, frames.Subscribe)]
    assert sorted(wanted[2:]) == sorted([(COLOUR, ros.COMPRESSED), (DEPTH, ros.IMAGE), (INFO, ros.INFO)])


def endpoint(node: str, kind: str = ros.IMAGE, type_hash: str = "") -> frames.Endpoint:
    return frames.Endpoint(node=node, type=kind, reliable=True, transient_local=False, hash=type_hash)


@pytest.mark.parametrize(
    ("graph", "says"),
    [
        (
            frames.Graph(topics={"/other": [ros.IMAGE]}, publishers={}, subscriptions={}),
            f"nothing publishes {COLOUR}; .* are /other",
        ),
        (
            frames.Graph(topics={**GRAPH.topics, DEPTH: [ros.CLOUD]}, publishers={}, subscriptions={}),
            f"{DEPTH} has the type {ros.CLOUD}, needed is .*{ros.IMAGE}",
        ),
        (
            frames.Graph(
                topics=GRAPH.topics, publishers={COLOUR: [endpoint("/one"), endpoint("/two")]}, subscriptions={}
            ),
            "2 publishers, /one and /two",
        ),
        (
            frames.Graph(
                topics=GRAPH.topics, publishers={DEPTH: [endpoint("/driver", type_hash="RIHS01_1")]}, subscriptions={}
            ),
            f"/driver publishes {DEPTH} with another definition",
        ),
        (GRAPH, f"no message has come on {COLOUR} and"),
    ],
)
def test_what_is_wrong_with_the_topics_is_named(graph: frames.Graph, says: str) -> None:
    node = Node()
    node.says(graph)
    assert re.search(says, refused(node))


def test_pictures_that_never_belong_together_are_named_with_both_rates() -> None:
    node = Node()
    node.places()
    node.says(GRAPH)
    for number in range(8):  # at 30 Hz and at 10 Hz, the depths between two pictures
        node.clock.time_ns += PERIOD_NS
        colour = ros.image(np.full((6, 8, 3), 50, np.uint8), "rgb8", stamp_ns=number * PERIOD_NS)
        node.publishes(INFO, ros.info(CAMERA, stamp_ns=number * PERIOD_NS))
        node.publishes(COLOUR, colour)
        if number % 3 == 0:
            depth = ros.image(np.full((6, 8), 700, np.uint16), "16UC1", stamp_ns=number * PERIOD_NS + 500 * PERIOD_NS)
            node.publishes(DEPTH, depth)
    assert re.search(r"colour comes at 30 Hz, depth comes at 10 Hz, none within half a period", refused(node))


def test_a_topic_that_the_node_cannot_read_is_named() -> None:
    node = Node()
    node.says(frames.Lacks(topic=TF_STATIC, why="the type tf2_msgs/msg/TFMessage is not installed"))
    assert "tf2_msgs/msg/TFMessage is not installed" in refused(node)


def test_damaged_messages_are_left_out() -> None:
    node = Node()
    node.says(frames.RosMessage(topic=TF_STATIC, type=ros.TF, arrived_ns=0), b"\x00\x01\x00\x00\xff\xff\xff\xff")
    node.says(frames.RosMessage(topic=COLOUR, type=ros.IMAGE, arrived_ns=0), b"garbage")
    node.places()
    captured(node, PERIOD_NS)


def test_a_camera_that_stamps_in_ros_time_is_stamped_exactly() -> None:
    clock = PictureClock()
    assert clock.stamped(1_000_000_000, 5_040_000_000, 37_000_000) == 5_003_000_000


@pytest.mark.parametrize("age_ns", [None, -1_000_000, 2_000_000_000])
def test_a_camera_with_a_clock_of_its_own_is_stamped_by_its_quickest_picture(age_ns: int | None) -> None:
    clock = PictureClock()
    clock.stamped(1_000_000_000, 5_020_000_000, age_ns)
    assert clock.stamped(1_100_000_000, 5_160_000_000, age_ns) == pytest.approx(5_115_000_000, abs=100_000)
