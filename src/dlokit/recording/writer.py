"""Writes messages to an MCAP file, and continues in a new file when it grows too large."""

import errno
import shutil
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from dlokit import __version__
from dlokit.communication.topic import Topic
from dlokit.communication.topics import ARM_STATE
from dlokit.description.scene import NO_EDGES
from dlokit.recording import foxglove
from dlokit.recording.channels import DEPTH_FORMAT, IMAGE_FORMAT, type_of
from dlokit.recording.message_json import json_schema, kind_name, to_json
from dlokit.recording.views import CAMERA, VIEWS, View, fixtures_view, to_jpeg, to_png, views_of
from dlokit.types.arrays import Float64Array
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun, CallRecord

PART_BYTES = 1_000_000_000
"""Size at which a recording continues in another file [bytes]; a live run with a camera writes about 1.2 GB an hour."""
PART_CHUNKS = 2400
"""Number of chunks after which it also continues in another file: the writer keeps an index of each, some 2.4 kB,
until the file is completed. A live run ends a chunk every 0.5 s."""
LARGEST_BYTES = 16_000_000_000
"""Largest size of all files of one recording [bytes]: the first and the newest are kept."""
RESERVE_BYTES = 32_000_000
"""A recording ends when less than this is free on its disk [bytes]: result, journal and report still fit."""

MOST_CALLERS = 10_000
"""Topics and callers whose messages are numbered; of further callers, gaps are not counted."""

_NO_PIXELS = np.empty((0, 0, 3), dtype=np.uint8)
_NO_DEPTH = np.empty((0, 0), dtype=np.float32)


def part_path(path: Path, number: int) -> Path:
    """File `number` of a recording: `recording.mcap`, then `recording.001.mcap`, …"""
    return path if number == 0 else path.with_name(f"{path.stem}.{number:03d}{path.suffix}")


class RecordingWriter:
    """Writes one recording; flushed messages survive a killed process. Raises `OSError` on file errors.

    A file that has reached `part_bytes`, or has `part_chunks`, is completed, and the next one begins, with the metadata
    again. When all files together exceed `largest_bytes`, the oldest are deleted, except the first.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, Mapping[str, str]],
        part_bytes: int = PART_BYTES,
        largest_bytes: int = LARGEST_BYTES,
        part_chunks: int = PART_CHUNKS,
        edges_world: Float64Array = NO_EDGES,
    ) -> None:
        """`metadata` is written first, so that a file that is cut off also contains it; the edges (E, 2, 3) [m] of the
        believed fixtures come before the first message of each file."""
        self._edges_world = edges_world
        self._path = path
        self._metadata = metadata
        self._part_bytes, self._largest_bytes, self._part_chunks = part_bytes, largest_bytes, part_chunks
        self._sizes: dict[int, int] = {}
        self._number = 0
        self._deleted = 0
        self._last_seq: dict[str, int] = {}
        self.lost: defaultdict[str, int] = defaultdict(int)
        """Number of missing sequence numbers by topic."""
        self._begin()

    def _begin(self) -> None:
        """Open the file of the current number."""
        self._stream = part_path(self._path, self._number).open("wb")
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        self._chunks = 0
        try:
            self._writer.start(library=f"dlokit {__version__}")
            for name, entries in self._metadata.items():
                self.add_metadata(name, entries)
            self._writer.flush()
        except OSError:
            self.abandon()
            raise

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add a metadata record with names and values."""
        self._writer.add_metadata(name, dict(entries))

    def add(self, topic: Topic[Any], log_ns: int, message: Message) -> None:
        """Write a message and its views; `log_ns` is the time of its arrival."""
        self._count_lost(topic, message)
        stamp_ns = message.stamp_ns
        if len(self._edges_world) and not self._channels:
            self._add("view/scene", log_ns, stamp_ns, 0, fixtures_view(stamp_ns, self._edges_world))
        # The images come before the message that refers to them, so that a reader has them in time.
        if isinstance(message, StereoImages):
            self._add_picture("view/left", log_ns, stamp_ns, to_jpeg(message.left), IMAGE_FORMAT)
            self._add_picture("view/right", log_ns, stamp_ns, to_jpeg(message.right), IMAGE_FORMAT)
        elif isinstance(message, DepthImage):
            self._add_picture("view/colour", log_ns, stamp_ns, to_jpeg(message.pixels), IMAGE_FORMAT)
            self._add_picture("view/depth", log_ns, stamp_ns, to_png(message.depth_m), DEPTH_FORMAT)
        # The simulated arm's sensor state duplicates the robot's state, which already has a view.
        for channel, view in () if topic.row == ARM_STATE.row else views_of(message):
            self._add(channel, log_ns, stamp_ns, 0, view)
        if isinstance(message, StereoImages):
            message = msgspec.structs.replace(message, left=_NO_PIXELS, right=_NO_PIXELS)
        if isinstance(message, DepthImage):
            message = msgspec.structs.replace(message, pixels=_NO_PIXELS, depth_m=_NO_DEPTH)
        self._add(topic.name, log_ns, stamp_ns, message.seq, message)

    def flush(self) -> None:
        """End the chunk and pass it to the operating system. Raises `OSError` when the disk is almost full."""
        before = self._stream.tell()
        self._writer.flush()
        self._chunks += self._stream.tell() > before
        if shutil.disk_usage(self._stream.fileno()).free < RESERVE_BYTES:
            raise OSError(errno.ENOSPC, f"less than {RESERVE_BYTES / 1e6:.0f} MB are free on the disk")
        if self._stream.tell() >= self._part_bytes or self._chunks >= self._part_chunks:
            self._next_part()

    def close(self) -> None:
        """Write the index and close the file. Raises `OSError`, also when a file was deleted meanwhile."""
        if self._deleted:
            self.add_metadata("deleted", {"files": str(self._deleted)})
        self._writer.finish()
        self._stream.close()
        part_path(self._path, self._number).stat()

    def _next_part(self) -> None:
        self._writer.finish()
        self._sizes[self._number] = self._stream.tell()
        self._stream.close()
        while sum(self._sizes.values()) + self._part_bytes > self._largest_bytes and len(self._sizes) > 1:
            oldest = min(set(self._sizes) - {0})
            part_path(self._path, oldest).unlink(missing_ok=True)
            del self._sizes[oldest]
            self._deleted += 1
        self._number += 1
        self._begin()

    def abandon(self) -> None:
        """Close the file without an index, after a write error."""
        try:
            self._stream.close()
        except OSError:
            # The buffered rest cannot be written either; the file is closed nevertheless.
            assert self._stream.closed

    def _count_lost(self, topic: Topic[Any], message: Message) -> None:
        # A topic has one publisher; calls are numbered by each caller.
        counted = f"{topic.name} {message.caller}" if isinstance(message, CallBegun | CallRecord) else topic.name
        last, seq = self._last_seq.get(counted), message.seq
        # A restarted publisher counts from 1.
        if last is not None and seq > last + 1:
            self.lost[topic.name] += seq - last - 1
        self._last_seq[counted] = seq
        if len(self._last_seq) > MOST_CALLERS:
            del self._last_seq[next(iter(self._last_seq))]

    def _add_picture(self, channel: str, log_ns: int, stamp_ns: int, data: bytes, kind: str) -> None:
        picture = foxglove.CompressedImage(
            timestamp=foxglove.time_of(stamp_ns), frame_id=CAMERA, data=data, format=kind
        )
        self._add(channel, log_ns, stamp_ns, 0, picture)

    def _add(self, channel: str, log_ns: int, stamp_ns: int, seq: int, value: Message | View) -> None:
        number = self._channels.get(channel)
        if number is None:
            number = self._channels[channel] = self._register(channel)
        # MCAP has no time before 0: a twin's cell shows the arm as it was a moment before the run began.
        published_ns = max(stamp_ns, 0)
        self._writer.add_message(number, log_time=log_ns, publish_time=published_ns, sequence=seq, data=_encoded(value))

    def _register(self, channel: str) -> int:
        if channel in VIEWS:
            name, schema = foxglove.schema_name(VIEWS[channel]), foxglove.schema_of(VIEWS[channel])
            encoding = schema_encoding = foxglove.ENCODING
        else:
            kind = type_of(channel)
            assert kind is not None, f"{channel} is not a topic"
            name, schema = f"dlokit.{kind_name(kind)}", json_schema(kind)
            encoding, schema_encoding = "json", "jsonschema"
        number = self._writer.register_schema(name, schema_encoding, schema)
        return self._writer.register_channel(channel, encoding, number)


def _encoded(value: Message | View) -> bytes:
    return to_json(value) if isinstance(value, Message) else value.SerializeToString(deterministic=True)
