"""What a node sees of cameras in ROS 2: topics, rates, encodings, ages, frames, and the settings for dlokit."""

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dlokit.errors import CommunicationError
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink
from dlokit.extras.ros2.pictures.images import COMPRESSED, IMAGE, is_colour, is_depth
from dlokit.extras.ros2.pictures.sight import TF_DEPTH
from dlokit.extras.ros2.pictures.sources import CAMERA_INFO, POINT_CLOUD
from dlokit.extras.ros2.pictures.transforms import TF, TF_KIND, TF_STATIC, NoChain, TransformTree

OF_CAMERAS = (IMAGE, COMPRESSED, POINT_CLOUD, CAMERA_INFO)


@dataclass(kw_only=True)
class SurveyedTopic:
    """What was received of a topic."""

    topic: str
    kind: str
    publishers: list[frames.Endpoint] = field(default_factory=list[frames.Endpoint])
    stamps_ns: list[int] = field(default_factory=list[int])
    """Stamps of its messages in ROS time [ns]."""
    ages_s: list[float] = field(default_factory=list[float])
    """Ages of its messages at their arrival [s]."""
    encoding: str = ""
    size: str = ""
    """Width and height, e.g. ``640 x 480``."""
    frame: str = ""
    flaw: str = ""
    is_colour: bool = False
    """Whether it has pictures with colours or brightness that are taken."""
    is_depth: bool = False
    """Whether it has pictures with depths that are taken."""

    @property
    def rate_hz(self) -> float:
        """Messages per second by their stamps; 0 where there are fewer than two."""
        periods_s = np.diff(self.stamps_ns) / 1e9
        return 0.0 if not len(periods_s) or np.median(periods_s) <= 0.0 else float(1.0 / np.median(periods_s))

    def __str__(self) -> str:
        reliable = {"reliable" if one.reliable else "best effort" for one in self.publishers}
        age = f"{np.median(self.ages_s) * 1e3:.0f} ms old" if self.ages_s else ""
        age = age if self.stamps_ns else "NO MESSAGE"
        rate = f"{self.rate_hz:.1f} Hz" if self.rate_hz else ""
        frame = f"frame {self.frame}" if self.frame else ""
        kind = f"{self.kind.rpartition('/')[2]} {self.encoding} {self.size}".strip()
        facts = (kind, rate, age, " and ".join(sorted(reliable)), frame, self.flaw.upper())
        return f"{self.topic}: {', '.join(fact for fact in facts if fact)}"


class Survey:
    """Listens to all topics of cameras and to TF through a link."""

    def __init__(self) -> None:
        self.link = NodeLink(self._joined, self._heard)
        self.topics: dict[str, SurveyedTopic] = {}
        self.tree = TransformTree()
        self.node: frames.Hello | None = None
        """The node that has answered."""
        self.lacks: dict[str, str] = {}
        """Why it cannot subscribe to a topic, by topic; both are kept when it leaves."""

    def _joined(self, hello: frames.Hello) -> None:
        self.node, self.topics = hello, {}
        for topic in (TF_STATIC, TF):
            self.link.send(frames.Subscribe(topic=topic, type=TF_KIND, depth=TF_DEPTH))

    def _heard(self, header: frames.FromNode, payload: bytes) -> None:
        match header:
            case frames.Graph():
                self._subscribe(header)
            case frames.Lacks():
                self.lacks = dict(self.link.lacks)
            case frames.RosMessage():
                with contextlib.suppress(CommunicationError):  # another definition: the row says so
                    self._receive(header, self.link.definitions.decode(header.type, payload))
            case _:
                pass

    def _subscribe(self, graph: frames.Graph) -> None:
        for topic, kinds in sorted(graph.topics.items()):
            if topic not in self.topics and len(kinds) == 1 and kinds[0] in OF_CAMERAS:
                self.topics[topic] = SurveyedTopic(topic=topic, kind=kinds[0])
                self.link.send(frames.Subscribe(topic=topic, type=kinds[0]))
        for topic, publishers in graph.publishers.items():
            if (one := self.topics.get(topic)) is not None:
                one.publishers = publishers
                one.flaw = self._flaw_of(one)

    def _flaw_of(self, one: SurveyedTopic) -> str:
        if len(one.publishers) > 1:
            return "published by " + " and ".join(publisher.node for publisher in one.publishers)
        expected = self.link.definitions.hash_of(one.kind)
        if any(publisher.hash not in ("", expected) for publisher in one.publishers):
            return "its publisher has another definition of the type"
        return ""

    def _receive(self, header: frames.RosMessage, message: Any) -> None:
        if header.topic in (TF, TF_STATIC):
            self.tree.add(message, static=header.topic == TF_STATIC)
            return
        one = self.topics[header.topic]
        stamp = message.header.stamp
        stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        one.stamps_ns.append(stamp_ns)
        if (ros_ns := self.link.ros_now_ns()) is not None:
            arrived_ns = ros_ns - (time.monotonic_ns() - header.arrived_ns)
            one.ages_s.append((arrived_ns - stamp_ns) / 1e9)
        one.frame = message.header.frame_id
        if one.kind == POINT_CLOUD:
            one.encoding = " ".join(part.name for part in message.fields)
        elif one.kind == CAMERA_INFO:
            one.encoding = message.distortion_model or "no distortion model"
        else:
            one.encoding = message.format if one.kind == COMPRESSED else message.encoding
            one.is_colour, one.is_depth = is_colour(message), is_depth(message)
        if one.kind != COMPRESSED:
            one.size = f"{message.width} x {message.height}"

    def settings(self) -> str:
        """The settings for dlokit's camera, ready to be copied; empty where no topics make a camera."""
        pictures = [one for one in self.topics.values() if one.stamps_ns and not one.flaw]
        colours, depths = ([one for one in pictures if one.is_colour], [one for one in pictures if one.is_depth])
        for colour in colours:
            for depth in depths:
                if colour.frame == depth.frame and colour.size == depth.size:
                    return f"--camera ros2 --camera.colour {colour.topic} --camera.depth {depth.topic}"
        for left in colours:
            for right in colours:
                if "left" in left.topic and right.topic == left.topic.replace("left", "right"):
                    return f"--camera ros2 --camera.colour {left.topic} --camera.right {right.topic}"
        clouds = [one for one in pictures if one.kind == POINT_CLOUD and "rgb" in one.encoding]
        return f"--camera ros2 --camera.cloud {clouds[0].topic}" if clouds else ""

    def poses(self, frame: str) -> Iterator[tuple[str, str]]:
        """For each frame of a picture: its name, and where it is seen from `frame`, or why it is unknown."""
        for camera in dict.fromkeys(one.frame for one in self.topics.values() if one.frame):
            stamp_ns = max(stamp for one in self.topics.values() if one.frame == camera for stamp in one.stamps_ns)
            try:
                x, y, z = self.tree.lookup(frame, camera, stamp_ns).position_m.tolist()
                yield camera, f"at ({x:.3f}, {y:.3f}, {z:.3f}) m from {frame}"
            except NoChain as error:
                yield camera, str(error)
