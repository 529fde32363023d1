"""The pictures of one camera in a bag of ROS 2 or ROS 1, with the calibration and the TF of the bag."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from dlokit.errors import CommunicationError, ConfigError, HardwareError
from dlokit.extras.ros2.definitions import DISTRIBUTIONS, Definitions, definitions_of, rosbags_part
from dlokit.extras.ros2.link.frames import Endpoint, Graph
from dlokit.extras.ros2.pictures.camera_pose import CameraPose
from dlokit.extras.ros2.pictures.images import COMPRESSED, IMAGE, is_colour, is_depth
from dlokit.extras.ros2.pictures.sources import CAMERA_INFO, POINT_CLOUD, Moment, PictureSource
from dlokit.extras.ros2.pictures.transforms import TF, TF_KIND, TF_STATIC, NoChain, NotThen, TransformTree
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.geometry import pose
from dlokit.types.image import CameraPictures

log = logging.getLogger(__name__)

ROS1_SUFFIX = ".bag"
_USUAL = "jazzy"
"""The definitions of a bag that does not name its distribution; those of pictures are equal in all."""
_HERE = pose((0.0, 0.0, 0.0))
_TRIED = 30
"""A bag whose first pictures, 1 s at 30 Hz, cannot be used is refused with the reason of the first one."""

_Message = tuple[str, str, int, bytes]
"""Topic, type, time of its recording [ns], CDR bytes."""


class BagPictures:
    """The pictures of one camera in a bag, with the stamps of their headers.

    The pose is that of the calibration file, or else of the camera's frame in the bag's TF, where it may move. All of
    TF is read first.
    """

    def __init__(self, path: Path, settings: RecordedCameraConfig) -> None:
        """Raises `ConfigError` when the bag cannot be read, or its topics or its TF do not make a camera."""
        self._path, self._settings = path, settings
        self._of_ros1 = path.suffix == ROS1_SUFFIX
        self.left_out: dict[str, str] = {}
        """Pictures that cannot be used, and why."""
        self._definitions = definitions_of(_USUAL)
        self._graph = self._contents()
        self._check_topics()
        self._tree = TransformTree(keep_all=True)
        self._pose = CameraPose(self._tree, settings.frame, _HERE, settings.calibration)
        self._infos = self._read_first()
        self.calibration = self._first().calibration
        """The calibration of the first pictures."""

    def _contents(self) -> Graph:
        """The bag's topics, as if it were the publisher of each; sets the definitions by its distribution."""
        with ExitStack() as stack:
            reader = _opened(self._path, stack)
            if not self._of_ros1 and reader.ros_distro in DISTRIBUTIONS:
                self._definitions = definitions_of(reader.ros_distro)
            topics: dict[str, list[str]] = {}
            publishers: dict[str, list[Endpoint]] = {}
            for one in reader.connections:
                kind = _kind(one)
                if kind not in topics.setdefault(one.topic, []):
                    topics[one.topic].append(kind)
                    # ROS 1 has sums of another form, and its definitions of pictures have the fields of ROS 2's.
                    digest = "" if self._of_ros1 else _hash(one, self._definitions)
                    endpoint = Endpoint(node="the bag", type=kind, reliable=True, transient_local=False, hash=digest)
                    publishers.setdefault(one.topic, []).append(endpoint)
        return Graph(topics=topics, publishers=publishers, subscriptions={})

    def _check_topics(self) -> None:
        try:
            source = PictureSource(self._settings, self._definitions.decode, self._graph.topics)
        except ConfigError as error:
            raise ConfigError(f"{error} The bag {self._path} has {self._flags()}.") from error
        flaw = source.flaw(self._graph, self._definitions)
        if flaw is not None:
            by_librealsense = ""
            if any(topic.startswith("/device_0/") for topic in self._graph.topics):
                by_librealsense = " librealsense recorded it: play it with --camera realsense --camera.file."
            raise ConfigError(
                f"the bag {self._path} cannot be played: {flaw}. It has {self._flags()}.{by_librealsense}"
            )

    def _flags(self) -> str:
        """The topics of the bag's pictures as settings, with what they hold."""
        wanted = {topic for topic, kinds in self._graph.topics.items() if {IMAGE, COMPRESSED, POINT_CLOUD} & {*kinds}}
        found: dict[str, str] = {}
        for topic, kind, _, cdr in self._messages(wanted):
            if topic not in found:
                found[topic] = self._flag(topic, kind, cdr)
            if len(found) == len(wanted):
                break
        return ", ".join(found[topic] for topic in sorted(found)) or "no pictures"

    def _flag(self, topic: str, kind: str, cdr: bytes) -> str:
        try:
            message = self._definitions.decode(kind, cdr)
        except CommunicationError:
            return f"{topic} (damaged)"
        frame = message.header.frame_id
        if kind == POINT_CLOUD:
            return f"--camera.cloud {topic} ({message.width} by {message.height} points, frame {frame!r})"
        form = message.format if kind == COMPRESSED else f"{message.encoding} {message.width} by {message.height} px"
        setting = "depth" if is_depth(message) else "colour" if is_colour(message) else ""
        if setting == "colour" and "right" in topic.split("/"):
            setting = "right"
        return f"--camera.{setting} {topic} ({form}, frame {frame!r})" if setting else f"{topic} ({form}: not taken)"

    def _read_first(self) -> list[_Message]:
        """Fill the tree of TF; the first CameraInfo of each topic, which the first pictures may precede."""
        infos: dict[str, _Message] = {}
        wanted = PictureSource(self._settings, self._definitions.decode, self._graph.topics).kinds
        topics = {topic for topic, kinds in wanted.items() if CAMERA_INFO in kinds}
        for message in self._messages({TF, TF_STATIC, *topics}):
            topic, kind, _, cdr = message
            if topic in topics:
                infos.setdefault(topic, message)
                continue
            if kind == TF_KIND:
                try:
                    self._tree.add(self._definitions.decode(kind, cdr), static=topic == TF_STATIC)
                except CommunicationError as error:
                    log.warning("left out: a message of %s: %s", topic, error)
        return list(infos.values())

    def _first(self) -> CameraPictures:
        """The first pictures that can be used. Raises `ConfigError`."""
        reasons: list[str] = []
        source = self._source()
        for moment in self._moments(source):
            try:
                return self._decoded(source, moment)
            except HardwareError as error:
                reasons.append(str(error))
                if len(reasons) == _TRIED:
                    break
        why = reasons[0] if reasons else source.no_pairs()
        raise ConfigError(f"the bag {self._path} has no pictures that can be used: {why}")

    def pictures(self) -> Iterator[CameraPictures]:
        """All pictures that can be used, in their order; the others are named in `left_out`."""
        source = self._source()
        for moment in self._moments(source):
            try:
                pictures = self._decoded(source, moment)
            except HardwareError as error:
                name = f"{next(iter(moment.parts.values())).topic} at {moment.stamp_ns / 1e9:.3f} s"
                log.warning("left out: %s: %s", name, error)
                self.left_out[name] = str(error)
                continue
            yield pictures
        self.left_out |= {f"{count} of {topic}": "damaged" for topic, count in source.damaged.items()}

    def _source(self) -> PictureSource:
        source = PictureSource(self._settings, self._definitions.decode, self._graph.topics)
        for topic, kind, log_ns, cdr in self._infos:
            source.add(topic, kind, cdr, log_ns)
        return source

    def _moments(self, source: PictureSource) -> Iterator[Moment]:
        for topic, kind, log_ns, cdr in self._messages(set(source.kinds)):
            moment = source.add(topic, kind, cdr, log_ns)
            if moment is not None:
                yield moment

    def _decoded(self, source: PictureSource, moment: Moment) -> CameraPictures:
        """The pictures of a moment. Raises `HardwareError`, and `ConfigError` where TF does not have the camera."""
        try:
            return source.pictures(moment, moment.stamp_ns, self._pose.of(source, moment))
        except NotThen:
            raise
        except NoChain as error:
            raise ConfigError(
                f"the bag {self._path} does not say where the camera is: {error}. --camera.frame names the frame that "
                "counts as the world."
            ) from error

    def _messages(self, topics: set[str]) -> Iterator[_Message]:
        """The messages of topics in the order of their recording. Raises `ConfigError` where the bag is damaged."""
        with ExitStack() as stack:
            reader = _opened(self._path, stack)
            connections = [one for one in reader.connections if one.topic in topics]
            if not connections:
                return
            messages = reader.messages(connections)
            while True:
                try:
                    item = next(messages, None)
                except Exception as error:  # rosbags indexes and unpacks what the file says
                    raise _unreadable(self._path, error) from error
                if item is None:
                    return
                connection, log_ns, data = item
                kind = _kind(connection)
                cdr = self._definitions.cdr_of_ros1(kind, data) if self._of_ros1 else bytes(data)
                yield connection.topic, kind, log_ns, cdr


def _opened(path: Path, stack: ExitStack) -> Any:
    """The reader of a bag, open until `stack` is closed. Raises `ConfigError`, `MachineError` without rosbags."""
    module = rosbags_part("rosbags.rosbag1" if path.suffix == ROS1_SUFFIX else "rosbags.rosbag2")
    try:
        return stack.enter_context(module.Reader(path))
    except Exception as error:  # rosbags indexes and unpacks what the file says
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> ConfigError:
    why = " ".join(str(error).split()) or type(error).__name__
    if path.suffix == ROS1_SUFFIX:
        return ConfigError(
            f"{path} cannot be read as a bag of ROS 1: {why}; give a file that `rosbag info` can read (`rosbag "
            "reindex` repairs a bag whose recorder was killed)"
        )
    return ConfigError(
        f"{path} cannot be read as a bag of ROS 2: {why}; give a folder with metadata.yaml, a .mcap or a .db3 file "
        "that `ros2 bag info` can read (`ros2 bag reindex` repairs a bag whose recorder was killed)"
    )


def _kind(connection: Any) -> str:
    """The type of a connection; TF had another name before ROS Hydro, with the same fields."""
    return TF_KIND if connection.msgtype == "tf/msg/tfMessage" else str(connection.msgtype)


def _hash(connection: Any, definitions: Definitions) -> str:
    """The hash of a connection's type; empty where the bag does not say more than its name."""
    if connection.digest:
        return str(connection.digest)
    text, known = connection.msgdef, definitions.knows(connection.msgtype)
    if not known or text.format.name != "MSG":
        return ""
    try:
        return definitions.hash_of(connection.msgtype) if definitions.agrees(connection.msgtype, text.data) else "other"
    except CommunicationError as error:
        return f"unreadable: {error}"
