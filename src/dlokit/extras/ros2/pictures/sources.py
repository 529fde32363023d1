"""The messages of a camera's topics, paired by their stamps and decoded; and what is wrong with topics."""

import logging
import struct
from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dlokit.errors import CommunicationError, HardwareError
from dlokit.extras.ros2.link.frames import Graph
from dlokit.extras.ros2.pictures.camera_info import (
    InfoOf,
    calibration_of,
    info_topic,
    pair_calibration_of,
    rectified_intrinsics,
)
from dlokit.extras.ros2.pictures.clouds import camera_in_frame, is_organised, picture_of
from dlokit.extras.ros2.pictures.images import COMPRESSED, IMAGE, colour_of, depth_of
from dlokit.functional.cameras.picture_topics import PictureTopics
from dlokit.geometry import pose
from dlokit.types.image import CameraPictures, DepthImage, StereoImages
from dlokit.types.pose import Pose

log = logging.getLogger(__name__)

CAMERA_INFO, POINT_CLOUD = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
_UNPAIRED = 8
"""Messages of a topic that wait for their partner: 0.25 s at 30 Hz, more than a driver takes to align depths."""
_STAMPS = 30
"""Messages from which the period and the rate of a topic are estimated."""
_LEAST_STAMPS = 4
_SAME_NS = 1_000_000
"""Largest difference of stamps in a pair before the period is known [ns]: drivers stamp one exposure once."""
_QUICK_QUANTILE = 0.1
"""Quantile of the differences of stamps that counts as the period: best effort loses up to two of three messages."""
_STOPPED_NS = 2_000_000_000
"""A topic that is silent for this long, while another one is not, has a rate of 0 [ns]."""
_ENDIAN = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""Encapsulations of CDR."""

Decode = Callable[[str, bytes], Any]
"""Decodes a message of a type; raises `CommunicationError`."""


class TypeHashes(Protocol):
    """The hashes of message types."""

    def hash_of(self, kind: str) -> str:
        """The hash of a type."""
        ...


@dataclass(frozen=True, kw_only=True)
class MessageHead:
    """The header of a message."""

    stamp_ns: int
    """ROS time [ns]."""
    frame_id: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A message as it arrived."""

    topic: str
    kind: str
    cdr: bytes
    head: MessageHead
    arrived_ns: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """The messages of one exposure, and the camera's calibration."""

    stamp_ns: int
    """Stamp of the colour picture, the left one, or the cloud [ns] in ROS time."""
    arrived_ns: int
    """Arrival of the last of its messages [ns], on the clock of `PictureSource.add`."""
    frame_id: str
    """Frame of the colour picture, the left one, or the cloud."""
    parts: Mapping[str, Part]
    """Pictures by setting: colour, depth, right, cloud."""
    infos: Mapping[str, Part]
    """CameraInfo by the same settings."""


def head_of(cdr: bytes) -> MessageHead:
    """The header of a message whose first field it is, from CDR bytes. Raises `CommunicationError`."""
    order = _ENDIAN.get(cdr[:2])
    try:
        if order is None:
            raise ValueError("no CDR")
        seconds, nanoseconds, length = struct.unpack_from(order + "iII", cdr, 4)
        frame = cdr[16 : 16 + length]
        if length == 0 or len(frame) < length:
            raise ValueError("cut off")
        return MessageHead(stamp_ns=seconds * 1_000_000_000 + nanoseconds, frame_id=frame[:-1].decode().lstrip("/"))
    except (struct.error, ValueError) as error:
        raise CommunicationError(f"{len(cdr)} bytes do not begin as a message with a header: {error}") from error


class PictureSource:
    """Pairs the messages of a camera by their stamps, each message once, and decodes the pairs."""

    def __init__(self, topics: PictureTopics, decode: Decode, known: Collection[str] = ()) -> None:
        """Where `known` are all topics that exist, the calibration may be beside the aligned depths, whose is the same.

        Raises `ConfigError` when the topics do not make a camera.
        """
        topics.check_topics()
        self._decode = decode
        self._pictures = topics.named  # the first one gives the stamp
        self._infos = {setting: info_topic(topic) for setting, topic in self._pictures.items() if setting != "depth"}
        aligned = info_topic(topics.depth)
        if topics.depth and self._infos["colour"] not in known and aligned in known:
            self._infos["colour"] = aligned
        self._last_infos: dict[str, Part] = {}
        self._arrivals = {topic: _Arrivals() for topic in (*self._pictures.values(), *self._infos.values())}
        self._counted = 0
        self.damaged: Counter[str] = Counter()
        """Messages by topic that do not begin as messages do."""

    @property
    def kinds(self) -> dict[str, tuple[str, ...]]:
        """The types that are taken of each topic, the usual one first; a cloud's camera_info may be missing."""
        found = {
            topic: (POINT_CLOUD,) if setting == "cloud" else _image_kinds(topic)
            for setting, topic in self._pictures.items()
        }
        return found | dict.fromkeys(self._infos.values(), (CAMERA_INFO,))

    @property
    def optional(self) -> frozenset[str]:
        """Topics that may be missing."""
        return frozenset(self._infos.values()) if "cloud" in self._pictures else frozenset()

    def add(self, topic: str, kind: str, cdr: bytes, arrived_ns: int) -> Moment | None:
        """Take a message that arrived at a time [ns]; the moment that it completes, if any.

        Messages of other topics are ignored, damaged ones are counted in `damaged`.
        """
        arrivals = self._arrivals.get(topic)
        if arrivals is None:
            return None
        try:
            part = Part(topic=topic, kind=kind, cdr=cdr, head=head_of(cdr), arrived_ns=arrived_ns)
        except CommunicationError as error:
            if not self.damaged[topic]:
                log.warning("left out: a message of %s: %s", topic, error)
            self.damaged[topic] += 1
            return None
        arrivals.add(part)
        if topic in self._infos.values():
            first = topic not in self._last_infos
            self._last_infos[topic] = part
            # Pictures that came before the first calibration have waited for it.
            pictures = [one for one in self._pictures.values() if self._arrivals[one].waiting]
            if not first or len(pictures) < len(self._pictures):
                return None
            topic = pictures[-1]
        missing = [one for one in self._infos.values() if one not in self._last_infos]
        return None if missing and not self.optional else self._completed(topic)

    def _completed(self, topic: str) -> Moment | None:
        """The moment that the newest message of a topic completes."""
        newest = self._arrivals[topic].waiting[-1]
        parts = {topic: newest}
        for other in self._pictures.values():
            if other != topic:
                near = self._arrivals[other].nearest(newest.head.stamp_ns)
                if near is None or abs(near.head.stamp_ns - newest.head.stamp_ns) > self._tolerance_ns():
                    return None
                parts[other] = near
        for one, part in parts.items():
            self._arrivals[one].use(part)
        self._counted += 1
        by_setting = {setting: parts[one] for setting, one in self._pictures.items()}
        first = next(iter(by_setting.values()))
        infos = {setting: self._last_infos[one] for setting, one in self._infos.items() if one in self._last_infos}
        return Moment(
            stamp_ns=first.head.stamp_ns,
            arrived_ns=max(part.arrived_ns for part in by_setting.values()),
            frame_id=first.head.frame_id,
            parts=by_setting,
            infos=infos,
        )

    def _tolerance_ns(self) -> float:
        """Half a period of the quicker topic [ns]; 1 ms before it is known."""
        periods_ns = [self._arrivals[topic].period_ns() for topic in self._pictures.values()]
        known_ns = [period_ns for period_ns in periods_ns if period_ns is not None]
        return min(known_ns) / 2.0 if len(known_ns) == len(periods_ns) else _SAME_NS

    @property
    def pairs(self) -> int:
        """Number of moments so far."""
        return self._counted

    def rates_hz(self) -> dict[str, float]:
        """Rate of each topic by the arrivals of its last messages [1/s]; 0 where none come."""
        newest_ns = max((one.last_ns for one in self._arrivals.values()), default=0)
        return {topic: one.rate_hz(newest_ns) for topic, one in self._arrivals.items()}

    def no_pairs(self) -> str:
        """Why there are no moments: silent topics, or the rates and the distance of the stamps."""
        silent = [topic for topic, one in self._arrivals.items() if not one.count and topic not in self.optional]
        if silent:
            damaged = "; ".join(f"{count} of {topic} were damaged" for topic, count in self.damaged.items())
            what = f"no message has come on {' and '.join(silent)}"
            return what + (
                f": {damaged}" if damaged else ": its publisher is silent, or its quality of service differs"
            )
        if len(self._pictures) == 1:
            return f"no cloud is waiting: {self._pictures['cloud']} comes at {self._rates()}"
        tolerance_ms = self._tolerance_ns() / 1e6
        first, second = (self._arrivals[topic] for topic in self._pictures.values())
        apart_ns = [
            abs(near.head.stamp_ns - one.head.stamp_ns)
            for one in first.waiting
            if (near := second.nearest(one.head.stamp_ns)) is not None
        ]
        nearest = f", the nearest stamps are {min(apart_ns) / 1e6:.0f} ms apart" if apart_ns else ""
        return (
            f"no pairs: {self._rates()}, none within half a period ({tolerance_ms:.0f} ms){nearest}; both must be "
            "stamped with the time of the same exposure: synchronise the camera's pictures in its driver"
        )

    def _rates(self) -> str:
        rates_hz = self.rates_hz()
        return ", ".join(f"{setting} comes at {rates_hz[topic]:.0f} Hz" for setting, topic in self._pictures.items())

    def camera_in_frame(self, moment: Moment) -> Pose:
        """T_frame_camera: pose of the camera (x right, y down, z forward) in the frame `moment.frame_id`.

        The identity for pictures; the frame of a cloud may look along x. Raises `HardwareError`.
        """
        if "cloud" not in moment.parts or "optical" in moment.frame_id:
            return pose((0.0, 0.0, 0.0))
        return camera_in_frame(self._message(moment.parts["cloud"]), moment.parts["cloud"].topic)

    def pictures(self, moment: Moment, stamp_ns: int, T_world_camera: Pose) -> CameraPictures:
        """The pictures of a moment, stamped with `stamp_ns`. Raises `HardwareError` where they cannot be used."""
        if "cloud" in moment.parts:
            return self._of_cloud(moment, stamp_ns, T_world_camera)
        if "right" in moment.parts:
            return self._of_pair(moment, stamp_ns, T_world_camera)
        colour, depth = moment.parts["colour"], moment.parts["depth"]
        if colour.head.frame_id != depth.head.frame_id:
            raise HardwareError(
                f"{depth.topic} is seen from {depth.head.frame_id!r}, {colour.topic} from {colour.head.frame_id!r}; "
                "depths must be aligned to the colours: turn that on in the driver (realsense-ros: align_depth.enable, "
                "topic aligned_depth_to_color/image_raw)"
            )
        pixels = colour_of(self._message(colour), colour.topic)
        depth_m = depth_of(self._message(depth), depth.topic)
        if depth_m.shape != pixels.shape[:2]:
            raise HardwareError(
                f"{depth.topic} is {depth_m.shape[1]} by {depth_m.shape[0]} px, {colour.topic} {pixels.shape[1]} by "
                f"{pixels.shape[0]} px; depths must be aligned to the colours: turn that on in the driver, or register "
                "them (depth_image_proc)"
            )
        calibration = calibration_of(self._info(moment, "colour", pixels.shape), T_world_camera)
        return DepthImage(stamp_ns=stamp_ns, frame="camera", pixels=pixels, depth_m=depth_m, calibration=calibration)

    def _of_pair(self, moment: Moment, stamp_ns: int, T_world_camera: Pose) -> StereoImages:
        parts = (moment.parts["colour"], moment.parts["right"])
        left, right = (colour_of(self._message(part), part.topic) for part in parts)
        infos = (self._info(moment, "colour", left.shape), self._info(moment, "right", right.shape))
        calibration = pair_calibration_of(*infos, T_world_camera)
        return StereoImages(stamp_ns=stamp_ns, frame="camera", left=left, right=right, calibration=calibration)

    def _of_cloud(self, moment: Moment, stamp_ns: int, T_world_camera: Pose) -> DepthImage:
        part = moment.parts["cloud"]
        cloud = self._message(part)
        optics = None
        if "cloud" in moment.infos and is_organised(cloud):
            info = self._info(moment, "cloud", (cloud.height, cloud.width))
            # One of another size is of the camera's pictures.
            if (info.message.width, info.message.height) == info.size_px and np.any(info.message.p):
                optics = rectified_intrinsics(info)
        return picture_of(cloud, optics, T_world_camera, stamp_ns, part.topic)

    def _info(self, moment: Moment, setting: str, shape: Sequence[int]) -> InfoOf:
        part = moment.infos[setting]
        return InfoOf(
            message=self._message(part),
            topic=part.topic,
            pictures=moment.parts[setting].topic,
            size_px=(shape[1], shape[0]),
        )

    def _message(self, part: Part) -> Any:
        try:
            return self._decode(part.kind, part.cdr)
        except CommunicationError as error:
            raise HardwareError(f"a message of {part.topic} is damaged: {error}") from error

    def flaw(self, graph: Graph, hashes: TypeHashes) -> str | None:
        """What is wrong with the camera's topics in ROS's graph, in a sentence; None if nothing is."""
        flaws = (
            flaw_of(topic, kinds, graph, hashes)
            for topic, kinds in self.kinds.items()
            if topic not in self.optional or topic in graph.topics
        )
        return next((flaw for flaw in flaws if flaw is not None), None)


def flaw_of(topic: str, kinds: Sequence[str], graph: Graph, hashes: TypeHashes) -> str | None:
    """What is wrong with a topic, in a sentence: missing, of another type, of two publishers, of another definition.

    `kinds` are the types that are taken. None if nothing is wrong.
    """
    found = graph.topics.get(topic)
    wanted = " or ".join(kinds)
    if not found:
        return f"nothing publishes {topic}; {_candidates(kinds, graph)}"
    if len(found) > 1 or found[0] not in kinds:
        return f"{topic} has the type {' and '.join(found)}, needed is {wanted}; {_candidates(kinds, graph)}"
    publishers = graph.publishers.get(topic, [])
    if len(publishers) > 1:
        nodes = " and ".join(one.node for one in publishers)
        return f"{topic} has {len(publishers)} publishers, {nodes}; it must have one: end the others, or rename theirs"
    other = [one for one in publishers if one.hash and one.hash != hashes.hash_of(found[0])]
    if other:
        return (
            f"{other[0].node} publishes {topic} with another definition of {found[0]} than the node's distribution "
            f"({other[0].hash}, not {hashes.hash_of(found[0])}); run both with one distribution"
        )
    return None


def _candidates(kinds: Sequence[str], graph: Graph) -> str:
    known = sorted(topic for topic, types in graph.topics.items() if set(types) & set(kinds))
    taken = " or ".join(kinds)
    return f"topics of {taken} are {', '.join(known)}" if known else f"no topic of {taken} is published"


def _image_kinds(topic: str) -> tuple[str, ...]:
    compressed = topic.endswith(("/compressed", "/compressedDepth"))
    return (COMPRESSED, IMAGE) if compressed else (IMAGE, COMPRESSED)


class _Arrivals:
    """The last messages of a topic."""

    def __init__(self) -> None:
        self.waiting = deque[Part](maxlen=_UNPAIRED)
        self.count = 0
        self._stamps_ns = deque[int](maxlen=_STAMPS)
        self._arrivals_ns = deque[int](maxlen=_STAMPS)

    def add(self, part: Part) -> None:
        self.waiting.append(part)
        self.count += 1
        self._stamps_ns.append(part.head.stamp_ns)
        self._arrivals_ns.append(part.arrived_ns)

    @property
    def last_ns(self) -> int:
        return self._arrivals_ns[-1] if self._arrivals_ns else 0

    def nearest(self, stamp_ns: int) -> Part | None:
        return min(self.waiting, key=lambda part: abs(part.head.stamp_ns - stamp_ns), default=None)

    def use(self, part: Part) -> None:
        """Remove a message, and those that arrived before it."""
        while self.waiting.popleft() is not part:
            pass

    def period_ns(self) -> float | None:
        """Time between two pictures [ns]; None before it is known."""
        if len(self._stamps_ns) < _LEAST_STAMPS:
            return None
        steps_ns = np.diff(np.array(self._stamps_ns))
        steps_ns = steps_ns[steps_ns > 0]
        return float(np.quantile(steps_ns, _QUICK_QUANTILE, method="higher")) if len(steps_ns) else None

    def rate_hz(self, newest_ns: int) -> float:
        if len(self._arrivals_ns) < 2 or newest_ns - self.last_ns > _STOPPED_NS:
            return 0.0
        return (len(self._arrivals_ns) - 1) / max(1e-9, (self.last_ns - self._arrivals_ns[0]) / 1e9)
