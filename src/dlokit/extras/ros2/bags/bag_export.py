"""`dlokit export --to rosbag2`: a recorded run as a rosbag2 (MCAP) with the topics that a live run publishes."""

import importlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dlokit.description.scene import Scene
from dlokit.errors import InputError, MachineError, install_command, require_cell
from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.extras.ros2.published.outgoing import Outgoing, Published, absolute
from dlokit.extras.ros2.published.ros_view import RosView
from dlokit.recording.channels import CLOCK, FILE_NAME, ChannelsOf, topic_of
from dlokit.recording.export_format import ExportFormat, Progress
from dlokit.recording.reader import RawRecording, stored_messages
from dlokit.system.configuration.recorded import recorded_config

NAME = "rosbag2"
DISTRIBUTION = "jazzy"
"""The definitions of the messages in bags are the same in all distributions from Humble to Lyrical."""
VERSION = 8
"""Version of the bag's metadata: the newest that Humble reads as well."""
DIAGNOSTICS_NS = 1_000_000_000
"""Period of ``/diagnostics`` [ns]."""


def check(paths: Sequence[Path]) -> None:
    """Raise `InputError` when a recording is not a run's, or two would have the same bag; `MachineError` where a
    package is missing."""
    require_cell(f"dlokit export --to {NAME}")
    _rosbag2()
    bags = [bag_name(path) for path in paths]
    for number, (path, bag) in enumerate(zip(paths, bags, strict=True)):
        if bag in bags[:number]:
            raise InputError(f"two runs would be written to the bag {bag}, one of them {path}: export them separately.")
        _facts(path)


def write(paths: Sequence[Path], out: Path, progress: Progress) -> list[str]:
    """Write a bag for each recording into `out`; a bag that is not complete is removed. Raises as `check`."""
    lines: list[str] = []
    for path in paths:
        bag = out / bag_name(path)
        try:
            count, since = write_bag(path, bag, progress)
        except BaseException:
            shutil.rmtree(bag, ignore_errors=True)
            raise
        lines.append(f"{bag}: {count} messages of {path}, {since}")
    return lines


def bag_name(path: Path) -> str:
    """Name of the bag of a recording: that of the run's folder, or of a recording that has a name of its own."""
    return path.resolve().parent.name if path.name == FILE_NAME else path.stem


@dataclass(frozen=True, kw_only=True)
class _Facts:
    """What is known of a run before its messages."""

    scene: Scene
    frame: str
    """Frame of the base of the first arm."""
    first_ns: int
    """Time of the first message on the run's clock [ns]."""
    messages: int
    offset_ns: int | None
    """Wall clock minus the run's clock [ns]; None for a recording of an earlier version, which lacks it."""


_CHANNELS = ChannelsOf(topic.row for topic in RosView.reads)


def _facts(path: Path) -> _Facts:
    raw, times_ns = RawRecording(path=path), list[int]()
    for channel, record in raw:
        if channel in _CHANNELS:
            times_ns.append(record.log_time)
    if not times_ns:
        raise InputError(f"{path} has nothing that is published in ROS 2; give the recording of a run.")
    config, clock = recorded_config(path, ("ros2",)), raw.metadata.get(CLOCK)
    return _Facts(
        scene=config.scene,
        frame=config.ros2.frame,
        first_ns=times_ns[0],
        messages=len(times_ns),
        offset_ns=None if clock is None else int(clock["real_ns"]) - int(clock["run_ns"]),
    )


def write_bag(path: Path, bag: Path, progress: Progress) -> tuple[int, str]:
    """Write one recording as the folder `bag`, which must not exist; returns the number of messages, and their clock.

    The time of a message is that of its arrival, its stamp that of its content, both on the wall clock: at the run's
    start, plus the time on the run's clock since then. Raises `InputError`, `MachineError` and `SchemaMismatch`.
    """
    facts, rosbag2 = _facts(path), _rosbag2()
    writer = rosbag2.Writer(bag, version=VERSION, storage_plugin=rosbag2.StoragePlugin.MCAP)
    writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        file = _Bag(writer, definitions_of(DISTRIBUTION), facts.offset_ns or 0)
        _write_messages(path, facts, file, progress)
    since = "stamped by the wall clock" if facts.offset_ns is not None else "stamped from 1970, as the run's clock"
    return file.count, since


def _write_messages(path: Path, facts: _Facts, file: "_Bag", progress: Progress) -> None:
    view = RosView(file.ros, file.ros_ns, scene=facts.scene, frame=facts.frame)
    file.write(facts.first_ns, *view.lasting(facts.first_ns))
    tick_ns = facts.first_ns
    for done, stored in enumerate(stored_messages(RawRecording(path=path), _CHANNELS)):
        while tick_ns <= stored.log_ns:
            file.write(tick_ns, view.diagnostics(tick_ns))
            progress(path, done, facts.messages)
            tick_ns += DIAGNOSTICS_NS
        topic = topic_of(stored.topic)
        assert topic is not None, "only channels of topics are read"
        file.write(stored.log_ns, *view.on(topic, stored.decoded().message))


class _Bag:
    """A bag that is written, with a topic for each row that has a message."""

    def __init__(self, writer: Any, ros: Definitions, offset_ns: int) -> None:
        self._writer = writer
        self.ros = ros
        self._offset_ns = offset_ns
        self._connections: dict[str, Any] = {}
        self.count = 0
        """Number of its messages."""

    def ros_ns(self, run_ns: int) -> int:
        """The time in the bag of a time on the run's clock [ns]."""
        return run_ns + self._offset_ns

    def write(self, log_ns: int, *messages: Outgoing) -> None:
        """Append messages of a time on the run's clock [ns]."""
        for one in messages:
            if one.row.topic not in self._connections:
                self._connections[one.row.topic] = self._connection(one.row)
            data = self.ros.encode(one.row.kind, one.message)
            self._writer.write(self._connections[one.row.topic], self.ros_ns(log_ns), data)
            self.count += 1

    def _connection(self, row: Published) -> Any:
        return self._writer.add_connection(
            absolute(row.topic),
            row.kind,
            msgdef=self.ros.text_of(row.kind),
            rihs01=self.ros.hash_of(row.kind),
            offered_qos_profiles=[_qos(row)],
        )


def _qos(row: Published) -> Any:
    """The quality of service that a live run offers for a topic."""
    of = importlib.import_module("rosbags.interfaces")
    forever = of.QosTime(*_FOREVER)
    return of.Qos(
        history=of.QosHistory.KEEP_LAST,
        depth=row.depth,
        reliability=of.QosReliability.RELIABLE,
        durability=of.QosDurability.TRANSIENT_LOCAL if row.transient_local else of.QosDurability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=of.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


_FOREVER = (9223372036, 854775807)
"""Seconds and nanoseconds by which rosbag2 says that a time is not limited."""


def _rosbag2() -> Any:
    try:
        return importlib.import_module("rosbags.rosbag2")
    except ModuleNotFoundError as error:
        raise MachineError(f"--to {NAME} needs rosbags, which is not installed: {install_command('ros2')}") from error


FORMAT = ExportFormat(
    name=NAME,
    doc="the topics that `--ros2` publishes, as a bag (MCAP) of ROS 2 for each run, in a folder of the run's name",
    check=check,
    write=write,
)
"""Joins `dlokit export` by the entry point `dlokit.exports`."""
