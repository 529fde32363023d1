"""The camera of a run as the node forwards it: its topics, its pose, and its stamps on the clock of the run."""

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dlokit.communication.log_rate import LogRate
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.errors import ClockJumped, CommunicationError, ConfigError, HardwareError
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import START_NODE, NodeLink
from dlokit.extras.ros2.pictures.camera_pose import CameraPose
from dlokit.extras.ros2.pictures.sources import Moment, PictureSource
from dlokit.extras.ros2.pictures.transforms import TF, TF_KIND, TF_STATIC, TransformTree
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE
from dlokit.functional.cameras.device_clock import DeviceClock
from dlokit.functional.cameras.picture_topics import PictureTopics
from dlokit.system.config import RunConfig
from dlokit.types.image import CameraPictures

log = logging.getLogger(__name__)

LEAST_LATENCY_NS = 5_000_000
"""Least time from a picture's stamp to its arrival at the node [ns], where ROS time is not known on the run's clock:
half an exposure and the transport on one machine."""
MOST_AGE_NS = 1_000_000_000
"""A picture that is older at its arrival, or younger than 0, was not stamped in ROS time [ns]."""
SEEN_WITHIN_S = 6.0
"""Longest wait for the first pictures of a connected node [s]; discovery takes up to 2.5 s."""
TF_DEPTH = 100
"""Transforms that may wait for the node; a robot publishes some hundred per second."""


class PictureClock:
    """Converts the stamps of pictures to the run's clock."""

    def __init__(self) -> None:
        self._device = DeviceClock(LEAST_LATENCY_NS)

    def stamped(self, stamp_ns: int, arrived_ns: int, age_ns: int | None) -> int:
        """The time of a picture [ns] on the run's clock, from its own stamp and its arrival on the run's clock.

        `age_ns` is its age in ROS time when it arrived, which is exact where the camera stamps in ROS time; None: the
        run's clock is not the machine's. Raises `ClockJumped` when the stamp contradicts earlier ones.
        """
        offset = self._device.arrived(stamp_ns, arrived_ns)
        if age_ns is not None and 0 <= age_ns <= MOST_AGE_NS:
            return arrived_ns - age_ns
        return stamp_ns + offset.offset_ns


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """The pictures of a moment, or the jump of the clock that its stamp shows."""

    moment: Moment
    stamp_ns: int
    jumped: str = ""


class RosSight:
    """The pictures that the node forwards."""

    def __init__(
        self,
        run: RunConfig,
        topics: PictureTopics,
        link: NodeLink,
        clock: Clock,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`clock` is the run's, `monotonic_ns` the machine's. Raises `ConfigError` for topics of no camera."""
        topics.check_topics()
        self._link, self._now_ns, self._monotonic_ns = link, clock.now_ns, monotonic_ns
        self._tree = TransformTree()
        self._source = PictureSource(topics, self._decoded)
        self._pose = _pose_of(run, topics, self._tree)
        self._clock, self._by_cell = PictureClock(), isinstance(clock, FollowedClock)
        self._subscribed: set[str] = set()
        self._newest: _Seen | None = None
        self._arrival = asyncio.Event()
        self._damaged = LogRate()

    def joined(self) -> None:
        """Begin with a node that has connected."""
        self._subscribed = set()
        for topic in (TF_STATIC, TF):
            self._link.send(frames.Subscribe(topic=topic, type=TF_KIND, depth=TF_DEPTH))

    def heard(self, header: frames.FromNode, payload: bytes) -> None:
        """Take a frame of the node; a damaged message is left out."""
        match header:
            case frames.RosMessage():
                try:
                    self._receive(header, payload)
                except CommunicationError as error:
                    if number := self._damaged.due(header.topic):
                        log.warning("ROS 2: messages left out: %d, the last on %s: %s", number, header.topic, error)
            case frames.Graph():
                self._subscribe(header)
            case _:
                pass

    def _receive(self, header: frames.RosMessage, payload: bytes) -> None:
        if header.topic in (TF, TF_STATIC):
            self._tree.add(self._decoded(TF_KIND, payload), static=header.topic == TF_STATIC)
            return
        moment = self._source.add(header.topic, header.type, payload, header.arrived_ns)
        if moment is not None:
            self._take(moment)

    def _decoded(self, kind: str, cdr: bytes) -> Any:
        return self._link.definitions.decode(kind, cdr)

    def _subscribe(self, graph: frames.Graph) -> None:
        """Subscribe to the camera's topics that are published, with the type that they have."""
        for topic, kinds in self._source.kinds.items():
            published = [kind for kind in graph.topics.get(topic, []) if kind in kinds]
            if topic not in self._subscribed and len(published) == 1:
                self._subscribed.add(topic)
                self._link.send(frames.Subscribe(topic=topic, type=published[0]))

    def _take(self, moment: Moment) -> None:
        since_ns = self._monotonic_ns() - moment.arrived_ns
        ros_ns = self._link.ros_now_ns()
        age_ns = None if ros_ns is None or self._by_cell else ros_ns - since_ns - moment.stamp_ns
        try:
            stamp_ns = self._clock.stamped(moment.stamp_ns, self._now_ns() - since_ns, age_ns)
            self._newest = _Seen(moment=moment, stamp_ns=stamp_ns)
        except ClockJumped as error:
            self._newest = _Seen(moment=moment, stamp_ns=self._now_ns(), jumped=str(error))
        self._arrival.set()

    async def next(self, timeout_s: float) -> CameraPictures:
        """The next pictures exposed after the call.

        Raises `HardwareError` when there are none within `timeout_s`, `ClockJumped` after a jump of their clock.
        """
        asked_ns = self._now_ns()
        try:
            async with asyncio.timeout(timeout_s):
                while self._newest is None or self._newest.stamp_ns < asked_ns:
                    self._arrival.clear()
                    await self._arrival.wait()
        except TimeoutError as error:
            raise HardwareError(f"no pictures from ROS 2 within {timeout_s:g} s: {self.missing()}") from error
        seen = self._newest
        if seen.jumped:
            raise ClockJumped(seen.jumped)
        return self._pictures(seen)

    def _pictures(self, seen: _Seen) -> CameraPictures:
        return self._source.pictures(seen.moment, seen.stamp_ns, self._pose.of(self._source, seen.moment))

    def missing(self) -> str:
        """Why there are no pictures."""
        if self._link.node is None:
            return f"no node is connected: start it with {START_NODE}"
        if self._link.lacks:
            return "; ".join(f"the node has no {topic}: {why}" for topic, why in self._link.lacks.items())
        if self._link.graph is None:
            return "the node has not described its topics yet"
        return self._source.flaw(self._link.graph, self._link.definitions) or self._source.no_pairs()

    async def examined(self) -> CameraPictures:
        """The first pictures, before a run starts; every mistake that shows in them is named.

        Raises `ConfigError` when there is no node, or no pictures of which a run can be made.
        """
        await self._link.require_node()
        loop, why = asyncio.get_running_loop(), ""
        end_s = loop.time() + SEEN_WITHIN_S
        while (left_s := end_s - loop.time()) > 0.0:
            try:
                return await self.next(min(left_s, 1.0))
            except HardwareError as error:
                why = str(error)
        raise ConfigError(why)


def _pose_of(run: RunConfig, topics: PictureTopics, tree: TransformTree) -> CameraPose:
    """The pose of the camera of a run; TF is not asked where the run places its cameras (`build.placed_camera`)."""
    placed = bool(run.calibration) or run.installation.camera is not None
    base = run.installation.in_world(run.installation.arms[0].pose)
    return CameraPose(tree, run.ros2.frame, base, topics.calibration, OVER_THE_TABLE if placed else None)
