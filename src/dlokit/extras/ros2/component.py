"""The component that is connected to ROS 2: publishes the run, and gives the pictures of a ROS camera."""

import asyncio
import logging
import time
from collections.abc import Iterable, Mapping
from typing import ClassVar

from dlokit.communication.component import Component, implements
from dlokit.communication.topic import Topic
from dlokit.errors import ClockJumped, HardwareError, SkillFailure
from dlokit.extras.ros2 import api
from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.extras.ros2.definitions import Definitions
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NodeLink, link_socket, listening
from dlokit.extras.ros2.pictures.sight import RosSight
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.diagnostics import LinkFacts, link_diagnosis
from dlokit.extras.ros2.published.outgoing import Outgoing, Published
from dlokit.extras.ros2.published.ros_view import RosView
from dlokit.system.config import RunConfig
from dlokit.types.image import CameraPictures, DepthImage, StereoImages
from dlokit.types.message import Message

log = logging.getLogger(__name__)

_DIAGNOSTICS_S = 1.0
_PICTURES = frozenset(row for row in outgoing.PUBLISHED if row.on_demand and row is not outgoing.JOINTS)


class RosComponent(Component):
    """Serves the link to the node; without a node nothing is published, and the run goes on."""

    name: ClassVar[str] = "ros"
    reads: ClassVar[tuple[Topic[Message], ...]] = RosView.reads

    def __init__(self, config: RunConfig) -> None:
        self._config = config
        self._link = NodeLink(self._joined, self._heard)
        self._sight: RosSight | None = None
        self._view: RosView | None = None
        self._advertised: tuple[Published, ...] = ()
        self._differs: dict[str, str] = {}
        """Topics whose type has another definition at the node, and what differs."""
        self._shown = False
        """Whether the node has got the messages for late subscribers."""

    @implements(api.CAPTURE)
    async def capture(self, timeout_s: float) -> StereoImages:
        """The next pair of pictures."""
        pictures = await self._next(timeout_s)
        if not isinstance(pictures, StereoImages):
            raise SkillFailure(api.NO_PICTURES, "the camera of this run is no stereo camera: call capture_depth")
        return pictures

    @implements(api.CAPTURE_DEPTH)
    async def capture_depth(self, timeout_s: float) -> DepthImage:
        """The next picture with depths."""
        pictures = await self._next(timeout_s)
        if not isinstance(pictures, DepthImage):
            raise SkillFailure(api.NO_PICTURES, "the camera of this run is no depth camera: call capture")
        return pictures

    async def _next(self, timeout_s: float) -> CameraPictures:
        if self._sight is None:
            raise SkillFailure(api.NO_PICTURES, "the camera of this run is not in ROS 2: use --camera ros2")
        try:
            return await self._sight.next(timeout_s)
        except ClockJumped as error:
            raise SkillFailure(api.CLOCK_JUMPED, str(error)) from error
        except HardwareError as error:
            reason = api.NO_NODE if self._link.node is None else api.NO_PICTURES
            raise SkillFailure(reason, str(error)) from error

    async def run(self) -> None:
        """Serve the link, and pass on what is published in the run."""
        if isinstance(self._config.camera, Ros2CameraConfig):
            self._sight = RosSight(self._config, self._config.camera, self._link, self.port.clock)
        async with (
            listening(self._link, link_socket(self._config.ros2.link)),
            asyncio.TaskGroup() as tasks,
        ):
            for topic in self._topics():
                tasks.create_task(self._follow(topic), name=f"ros2 {topic.name}")
            while True:
                self._diagnose()
                await asyncio.sleep(_DIAGNOSTICS_S)

    def _topics(self) -> list[Topic[Message]]:
        """The topics that it shows, of every instance."""
        others = [mount.instance for mount in self._config.mounts if mount.instance]
        return [*self.reads, *(topic.at(name) for topic in self.reads if topic.publisher == "robot" for name in others)]

    async def _follow(self, topic: Topic[Message]) -> None:
        async for message in self.port.stream(topic):
            if self._view is not None:
                self._publish(*self._view.on(topic, message))

    def _joined(self, hello: frames.Hello) -> None:
        self._shown = False
        self._advertise(hello)
        view = RosView(
            self._link.definitions,
            self._ros_ns,
            scene=self._config.scene,
            frame=self._config.ros2.frame,
            wanted=self._is_wanted,
        )
        for topic in self._topics():
            if (last := self.port.latest(topic).value) is not None:
                view.on(topic, last)
        self._view = view
        if self._sight is not None:
            self._sight.joined()

    def _advertise(self, hello: frames.Hello) -> None:
        """Advertise the topics whose types the node has with the same definition."""
        # The pictures of a camera in ROS are there already.
        rows = [row for row in outgoing.PUBLISHED if self._sight is None or row not in _PICTURES]
        self._differs = differing(rows, hello.hashes, self._link.definitions)
        for topic, why in self._differs.items():
            log.warning("ROS 2: %s is not published: %s", topic, why)
        self._advertised = tuple(row for row in rows if row.topic not in self._differs)
        for row in self._advertised:
            lasting = row.transient_local
            header = frames.Advertise(topic=row.topic, type=row.kind, transient_local=lasting, depth=row.depth)
            self._link.send(header)

    def _heard(self, header: frames.FromNode, payload: bytes) -> None:
        if not self._shown and self._link.clocks is not None and self._view is not None:  # stamps need its clocks
            self._shown = True
            self._publish(*self._view.lasting(self.port.clock.now_ns()))
        if self._sight is not None:
            self._sight.heard(header, payload)

    def _ros_ns(self, stamp_ns: int) -> int:
        """A stamp of the run's clock in ROS time [ns]."""
        now_ns = self._link.ros_now_ns()
        return 0 if now_ns is None else now_ns - (self.port.clock.now_ns() - stamp_ns)

    def _is_wanted(self, row: Published) -> bool:
        return self._link.graph is not None and bool(self._link.graph.subscriptions.get(row.topic))

    def _publish(self, *messages: Outgoing) -> None:
        if self._link.node is None or self._link.clocks is None:
            return
        for one in messages:
            if one.row in self._advertised and one.row.topic not in self._link.lacks:
                payload = self._link.definitions.encode(one.row.kind, one.message)
                self._link.send(frames.Publish(topic=one.row.topic), payload)

    def _diagnose(self) -> None:
        node, clocks = self._link.node, self._link.clocks
        if self._view is None or node is None:
            return
        facts = LinkFacts(
            graph=self._link.graph,
            dropped=self._link.dropped + (0 if clocks is None else clocks.dropped),
            clock_offset_ns=None if clocks is None else clocks.ros_ns - clocks.monotonic_ns + _wall_ns(),
            lacks={**self._differs, **self._link.lacks},
        )
        now_ns = self.port.clock.now_ns()
        self._publish(self._view.diagnostics(now_ns, [link_diagnosis(facts, self._advertised, node.node)]))


def differing(rows: Iterable[Published], hashes: Mapping[str, str], definitions: Definitions) -> dict[str, str]:
    """The topics whose type has another definition at the node, by their type hashes, and what differs."""
    return {
        row.topic: f"the node has another definition of {row.kind} than ROS 2 {definitions.distribution}"
        for row in rows
        if hashes.get(row.kind, "") not in ("", definitions.hash_of(row.kind))
    }


def _wall_ns() -> int:
    """Monotonic time minus the wall clock [ns]."""
    return time.monotonic_ns() - time.time_ns()
