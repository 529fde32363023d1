"""Records a run while it goes on, on a thread of its own: the run neither waits for the disk nor ends with it."""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dlokit.communication.timing.urgency import BoundedUrgency, never_urgent
from dlokit.communication.topic import Topic
from dlokit.communication.topics import STEREO_IMAGES
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.recording.channels import IMAGES_PER_S
from dlokit.recording.writer import RecordingWriter
from dlokit.types.message import Message

log = logging.getLogger(__name__)

FLUSH_EVERY_S = 0.5
"""A process that is killed loses what came since, on the machine's clock."""
BATCH_EVERY_S = 0.1
"""A thread that woke for each message would cost the run more than writing does."""
WAITING = 1024
"""Messages that may wait for the disk: 5 s of a live run."""
PATIENCE_S = 10.0
"""A lockstep run, which may wait, waits so long for the disk; so does the end of a run."""


@dataclass(frozen=True)
class _Item:
    topic: Topic[Any]
    log_ns: int
    message: Message | bytes | Callable[[], Message]
    """Encoded, when it comes from another process; a function makes it on the writer's thread."""


class Recorder:
    """Takes messages from any thread and writes them. Use as a context manager."""

    def __init__(
        self,
        path: Path,
        now_ns: Callable[[], int],
        metadata: Mapping[str, Mapping[str, str]],
        *,
        patient: bool,
    ) -> None:
        """`now_ns` is the run's clock. Who is not `patient` loses messages when the disk is slow, and counts them."""
        self._path = path
        self._now_ns = now_ns
        self._metadata = metadata
        self._patient = patient
        self._waiting: queue.Queue[_Item] = queue.Queue(WAITING)
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._last_pair_ns: int | None = None
        self._thinned = 0
        self._handed = set[str]()
        self._closed = False
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)

    def __enter__(self) -> "Recorder":
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._closed = True
        self._ending.set()
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            log.warning("recording_slow: %s is not written to its end: the disk does not answer", self._path)

    def put(self, topic: Topic[Any], message: Message | bytes | Callable[[], Message]) -> None:
        """Record a message that nobody changes any more; returns at once where the run may not wait.

        A function is called on the writer's thread, and returns the message.
        """
        if self._closed:
            return
        log_ns = self._now_ns()
        self._handed.add(topic.name)
        if topic is STEREO_IMAGES and self._thinned_out(log_ns):
            return
        try:
            self._waiting.put(_Item(topic, log_ns, message), self._patient, PATIENCE_S)
        except queue.Full:
            if self._patient:
                log.warning("recording_failed: %s: the disk does not answer; the run goes on without it", self._path)
                self._closed = True

    def has(self, topic: Topic[Any]) -> bool:
        """Whether anything of a topic was handed over."""
        return topic.name in self._handed

    def _thinned_out(self, log_ns: int) -> bool:
        with self._lock:
            last = self._last_pair_ns
            if last is not None and 0 <= log_ns - last < 1e9 / IMAGES_PER_S:
                self._thinned += 1
                return True
            self._last_pair_ns = log_ns
            return False

    def _write_all(self) -> None:
        try:
            writer = RecordingWriter(self._path, self._metadata)
        except OSError as error:
            self._give_up(error)
            return
        try:
            self._write_until_end(writer)
            lost = dict(writer.lost)
            if self._thinned:
                lost[STEREO_IMAGES.name] = max(0, lost.get(STEREO_IMAGES.name, 0) - self._thinned)
            writer.add_metadata("thinned", {STEREO_IMAGES.name: str(self._thinned)})
            writer.add_metadata("lost", {name: str(number) for name, number in lost.items() if number})
            writer.close()
        except Exception as error:  # whatever it is, the run goes on without it
            writer.abandon()
            self._give_up(error)

    def _write_until_end(self, writer: RecordingWriter) -> None:
        flush_at_s = time.monotonic() + FLUSH_EVERY_S
        ending = False
        # While it holds the interpreter's lock, and is put aside, no heartbeat of this process is given.
        urgency = never_urgent if self._patient else BoundedUrgency()
        while not ending:
            urgency(True)
            ending = self._ending.wait(BATCH_EVERY_S)
            # No more than wait now: a flush must not be put off by what comes meanwhile.
            for _ in range(self._waiting.qsize()):
                self._write(writer, self._waiting.get_nowait())
            if time.monotonic() >= flush_at_s:
                writer.flush()
                flush_at_s = time.monotonic() + FLUSH_EVERY_S

    @staticmethod
    def _write(writer: RecordingWriter, item: _Item) -> None:
        message = item.message
        try:
            if isinstance(message, bytes):
                message = codec.decode(message, item.topic.type)
            elif not isinstance(message, Message):
                message = message()
        except CommunicationError as error:
            log.warning("a message on %s is not recorded: %s", item.topic.name, error)
            return
        writer.add(item.topic, item.log_ns, message)

    def _give_up(self, error: Exception) -> None:
        log.warning("recording_failed: %s: %s; the run goes on without a recording", self._path, error)
        self._closed = True
        with contextlib.suppress(queue.Empty):  # whoever waits for room is let go
            while True:
                self._waiting.get_nowait()
