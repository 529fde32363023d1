"""Read recordings, including those whose writer was killed, in order or by time."""

import glob
import logging
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

from mcap.reader import make_reader
from mcap.records import Channel, Chunk, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from dlokit.communication.topics import DEPTH_IMAGES, STEREO_IMAGES
from dlokit.errors import CommunicationError, InputError, SchemaMismatch
from dlokit.recording import foxglove
from dlokit.recording.channels import FILE_NAME, in_order, recorded_topics, type_of
from dlokit.recording.message_json import from_plain, parsed_json
from dlokit.recording.views import VIEWS, from_jpeg, from_png
from dlokit.types.message import Message

_PICTURES_OF = {STEREO_IMAGES.name: ("view/left", "view/right"), DEPTH_IMAGES.name: ("view/colour", "view/depth")}
_PICTURES = frozenset(name for names in _PICTURES_OF.values() for name in names)
_MAGIC = b"\x89MCAP0\r\n"
_OWN = ("dlokit.", "foxglove.")
"""Beginnings of the names of the message types that dlokit records."""
_CONFIG = "config.toml"
"""Name of a run's configuration, in its folder and in its recording."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """One message of a recording."""

    topic: str
    log_ns: int
    """Time of arrival on the run's clock [ns]; the message's own stamp is the time to which its content refers."""
    message: Message


@dataclass(frozen=True, kw_only=True)
class StoredMessage:
    """One encoded message of a recording, decoded on request."""

    topic: str
    log_ns: int
    """As in `Recorded`."""
    data: bytes
    pictures: Mapping[str, bytes]
    """The picture files that belong to it, by channel; empty for messages without pictures."""

    def decoded(self) -> Recorded:
        """The message. Raises `SchemaMismatch` and `CommunicationError` as `read_recording` does."""
        return Recorded(topic=self.topic, log_ns=self.log_ns, message=_message(self.topic, self.data, self.pictures))


def recording_file(path: Path) -> Path:
    """The recording in the folder of a run; any other path is returned as the recording's own path."""
    return path / FILE_NAME if path.is_dir() else path


def files_of(path: Path) -> list[Path]:
    """The files of a recording in order: `recording.mcap`, and `recording.001.mcap`, … where it became too large."""
    return [path, *in_order(path.parent.glob(f"{glob.escape(path.stem)}.[0-9][0-9][0-9]*{path.suffix}"))]


def _not_recorded(path: Path) -> str:
    """How to get the recording of a run that has none, as those of a bench; empty where no run is in the folder."""
    config = path.parent / _CONFIG
    if path.name != FILE_NAME or path.exists() or not config.is_file():
        return ""
    return (
        f"The run in {path.parent} has no recording: it was made with --no-record, or by a bench without --record. "
        f"Repeat it with one: dlokit shape --record --config {config}; or the bench with --record (in Python "
        'settings={"record": True}) and another folder.'
    )


@dataclass(kw_only=True)
class RawRecording:
    """Records of a recording in order, not decoded. Iterate once; iteration fills the other fields."""

    path: Path
    """Its first file, or any other one alone."""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])
    schemas: dict[str, str] = field(default_factory=dict[str, str])
    """Name of the message type by channel."""
    missing: str = ""
    """The parts of its files that could not be read, as text; empty when the files are complete."""

    def __iter__(self) -> Iterator[tuple[str, McapMessage]]:
        """Yield channel and message. Raises `InputError` when the file is not a recording."""
        self.missing = ""
        for file in files_of(self.path):
            yield from self._of_file(file)

    def require_own(self) -> None:
        """Raise `InputError` when all channels read so far are another program's, e.g. in a ROS 2 bag."""
        if self.schemas and not any(name.startswith(_OWN) for name in self.schemas.values()):
            raise InputError(
                f"{self.path} has no message of dlokit, but {', '.join(self.schemas)}; give the recording.mcap of a "
                "run's folder."
            )

    def _of_file(self, path: Path) -> Iterator[tuple[str, McapMessage]]:
        try:
            with path.open("rb") as stream:
                if (head := stream.read(len(_MAGIC))) != _MAGIC:
                    what = "is empty" if not head else "is not an MCAP file"
                    raise InputError(f"{path} {what}; give the recording.mcap of a run's folder.")
                yield from self._messages(path, stream)
        except OSError as error:
            unreadable = f"{path} cannot be read ({error.strerror}); give the recording.mcap of a run's folder."
            raise InputError(_not_recorded(path) or unreadable) from error

    def _messages(self, path: Path, stream: IO[bytes]) -> Iterator[tuple[str, McapMessage]]:
        channels: dict[int, str] = {}  # each file has its own numbers
        schemas: dict[int, str] = {}
        for record in self._records(path, stream):
            match record:
                case McapMessage():
                    if (channel := channels.get(record.channel_id)) is not None:
                        yield channel, record
                case Channel():
                    channels[record.id] = record.topic
                    self.schemas[record.topic] = schemas.get(record.schema_id, "")
                case Schema():
                    schemas[record.id] = record.name
                case Metadata():
                    self.metadata[record.name] = record.metadata
                case _:
                    pass

    def _records(self, path: Path, stream: IO[bytes]) -> Iterator[McapRecord]:
        """The records of a file to its end, or to where it was cut off, without its damaged chunks."""
        records, damaged, ends = StreamReader(stream, skip_magic=True, emit_chunks=True).records, 0, ""
        while not ends:
            try:
                record = next(records)
            except StopIteration:
                break
            except Exception:  # an error of the parser marks the byte at which the file was cut off
                at = stream.tell()
                ends = f"{path.name} ends in the middle of its records, at byte {at}"
                if stream.read(1):
                    ends = f"{path.name} cannot be read beyond byte {at}"
                break
            if not isinstance(record, Chunk):
                yield record
                continue
            try:
                parts = breakup_chunk(record, validate_crc=True)
            except Exception:  # a wrong check sum, or data that no longer decompress
                damaged += 1
                parts = _declared(path) if damaged == 1 else []
            yield from parts
        skipped = f"{damaged} of the chunks of {path.name} are damaged and skipped" if damaged else ""
        self.missing = ", ".join(filter(None, (self.missing, skipped, ends)))


def _declared(path: Path) -> list[McapRecord]:
    """The schemas and channels of a file by the summary at its end: a damaged chunk may have declared them."""
    try:
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
    except Exception:  # the file is cut off, too
        return []
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def toml_of(metadata: Mapping[str, Mapping[str, str]], path: Path) -> str:
    """The `config.toml` in the metadata of a recording. Raises `InputError`, which names its `path`."""
    text = metadata.get("configuration", {}).get(_CONFIG)
    if text is None:
        raise InputError(f"{path} has no configuration of its run; give the recording.mcap of a run's folder.")
    return text


def missing_part(path: Path) -> str:
    """The unreadable parts of a recording, as text; empty when complete. Raises `InputError` for other files."""
    raw = RawRecording(path=path)
    count = sum(1 for _ in raw)
    raw.require_own()
    return raw.missing or ("" if count else "it contains no message")


@cache
def _warn(path: Path, missing: str) -> None:
    """Warn once for each recording, even when it is read again."""
    log.warning("%s is incomplete: %s.", path, missing)


def read_recording(path: Path, only: Container[str] | None = None) -> Iterator[Recorded]:
    """Read the messages of all topics and the skill calls, or only of the channels `only`, in the order of arrival.

    They equal the published messages, except for images, which have JPEG quality, and depths, which are rounded to
    millimetres. Raises `InputError` when the file is not a recording, and `SchemaMismatch` when another version wrote
    messages that this one cannot read.
    """
    for stored in stored_messages(RawRecording(path=path), only):
        yield stored.decoded()


def stored_messages(raw: RawRecording, only: Container[str] | None = None) -> Iterator[StoredMessage]:
    """As `read_recording`, not decoded. Missing parts are logged."""
    pictures: dict[str, bytes] = {}
    for channel, record in raw:
        if channel in _PICTURES:
            pictures[channel] = record.data
        elif channel not in VIEWS and (only is None or channel in only):
            own = {name: pictures[name] for name in _PICTURES_OF.get(channel, ()) if name in pictures}
            yield StoredMessage(topic=channel, log_ns=record.log_time, data=record.data, pictures=own)
    raw.require_own()
    if raw.missing:
        _warn(raw.path, raw.missing)


def picture_file(data: bytes) -> foxglove.CompressedImage:
    """Decode an image message of `view/left`, `view/right`, `view/colour` or `view/depth`. Raises `SchemaMismatch`."""
    try:
        return foxglove.from_bytes(data, foxglove.CompressedImage)
    except CommunicationError as error:
        raise SchemaMismatch(f"{error}; another version wrote the file: read it with that version") from error


def _message(channel: str, data: bytes, pictures: Mapping[str, bytes]) -> Message:
    kind = type_of(channel)
    if kind is None:
        raise SchemaMismatch(f"{channel} is not a topic of this version or its packages: {sorted(recorded_topics())}")
    plain: Any = parsed_json(data)
    if channel == STEREO_IMAGES.name:
        for side in ("left", "right"):
            plain[side] = from_jpeg(picture_file(pictures[f"view/{side}"]).data)
    if channel == DEPTH_IMAGES.name:
        plain["pixels"] = from_jpeg(picture_file(pictures["view/colour"]).data)
        plain["depth_m"] = from_png(picture_file(pictures["view/depth"]).data)
    return from_plain(plain, kind)


_LOG_NS = attrgetter("log_ns")


class MessagesByTime:
    """The messages of some channels of a recording, kept in memory in encoded form and decoded on request."""

    def __init__(self, path: Path, channels: Container[str], every: Container[str]) -> None:
        """`channels` are read; for channels in `every`, all messages are returned, for the rest only the last one.

        Raises `InputError` when the file is not a recording, or contains no message of `channels`.
        """
        self._every = every
        self._stored: defaultdict[str, list[StoredMessage]] = defaultdict(list)
        raw = RawRecording(path=path)
        for stored in stored_messages(raw, channels):
            self._stored[stored.topic].append(stored)
        if not self._stored:
            raise InputError(f"{path} contains nothing to show; give the recording of a run of dlokit shape.")
        self.metadata = raw.metadata
        self.first_ns = min(stored[0].log_ns for stored in self._stored.values())
        self.last_ns = max(stored[-1].log_ns for stored in self._stored.values())

    def of(self, channel: str, *, min_gap_ns: int = 0) -> Iterator[Recorded]:
        """The messages of one channel, decoded, without those less than `min_gap_ns` [ns] after the previous one."""
        last_ns: int | None = None
        for stored in self._stored.get(channel, ()):
            if last_ns is None or stored.log_ns - last_ns >= min_gap_ns:
                last_ns = stored.log_ns
                yield stored.decoded()

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that have messages."""
        return tuple(self._stored)

    def due(self, after_ns: int | None, until_ns: int) -> list[Recorded]:
        """The messages after `after_ns` (None: from the beginning) and until `until_ns` [ns], in order of arrival."""
        found: list[StoredMessage] = []
        for channel, stored in self._stored.items():
            first = 0 if after_ns is None else bisect_right(stored, after_ns, key=_LOG_NS)
            end = bisect_right(stored, until_ns, key=_LOG_NS)
            found += stored[first if channel in self._every else max(first, end - 1) : end]
        return [each.decoded() for each in sorted(found, key=_LOG_NS)]
