"""The messages of a recording by time: what a reader of its topics has seen at any moment."""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Container, Iterator
from operator import attrgetter
from pathlib import Path

from dlokit.errors import InputError
from dlokit.recording.reader import RawRecording, Recorded, StoredMessage, stored_messages

_LOG_NS = attrgetter("log_ns")


class MessagesByTime:
    """The messages of some channels of a recording, kept in memory in encoded form and decoded on request."""

    def __init__(self, path: Path, channels: Container[str], every: Container[str]) -> None:
        """`channels` are those to read; of those in `every`, all messages are due, of the others only the last one.

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
        """What arrived after `after_ns` (None: from the beginning) and until `until_ns` [ns], in order of arrival."""
        found: list[StoredMessage] = []
        for channel, stored in self._stored.items():
            first = 0 if after_ns is None else bisect_right(stored, after_ns, key=_LOG_NS)
            end = bisect_right(stored, until_ns, key=_LOG_NS)
            found += stored[first if channel in self._every else max(first, end - 1) : end]
        return [each.decoded() for each in sorted(found, key=_LOG_NS)]
