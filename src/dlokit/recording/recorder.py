"""Records a run on a separate thread: the run does not wait for the disk, and a disk error does not end it."""

import contextlib
import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dlokit.communication.log_rate import LogRate
from dlokit.communication.timing.urgency import BoundedUrgency, never_urgent
from dlokit.communication.topic import Topic
from dlokit.communication.wire import codec
from dlokit.description.scene import NO_EDGES
from dlokit.errors import CommunicationError
from dlokit.recording.channels import CLOCK, IMAGES_PER_S, PICTURE_ROWS
from dlokit.recording.disk import DISK_TIMEOUT_S, NO_ANSWER, reason_of
from dlokit.recording.writer import RecordingWriter
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message
from dlokit.types.robot import RobotState

REST_BEGINS_S = 1.0
"""An arm is at rest once it has not moved for this long [s of the run's clock]; until then every state is recorded, so
that a replayed component sees how the arm settled."""
REST_STATES_PER_S = 10.0
"""Rate of the recorded states of an arm at rest [1/s]; a reader never finds a gap that looks like a lost arm."""
_STILL_RAD = 1e-4
"""Largest joint movement of an arm at rest [rad]: above the noise of encoders, below 0.1 mm at the tool."""
_STILL_RAD_S = 1e-3
"""Largest joint velocity of an arm at rest [rad/s]."""
_STILL_M = 1e-5
"""Largest movement of resting fingers [m]."""


@dataclass
class _Rest:
    """An arm that has not moved since `begin_ns` [ns of the run's clock]."""

    state: RobotState
    begin_ns: int
    kept_ns: int


class RestThinning:
    """Selects the states of arms that are recorded."""

    def __init__(self) -> None:
        self._rests: dict[str, _Rest] = {}

    def keeps(self, channel: str, log_ns: int, state: RobotState) -> bool:
        """Whether the state that arrived on `channel` at `log_ns` is recorded."""
        rest = self._rests.get(channel)
        if rest is None or not _still(rest.state, state) or log_ns < rest.kept_ns:
            self._rests[channel] = _Rest(state, log_ns, log_ns)
            return True
        if log_ns - rest.begin_ns >= 1e9 * REST_BEGINS_S and log_ns - rest.kept_ns < 1e9 / REST_STATES_PER_S:
            return False
        rest.kept_ns = log_ns
        return True


def _still(before: RobotState, now: RobotState) -> bool:
    return (
        (before.mode, before.holding, before.stop_latched) == (now.mode, now.holding, now.stop_latched)
        and abs(now.finger_width_m - before.finger_width_m) <= _STILL_M
        and bool(np.all(np.abs(now.q_rad - before.q_rad) <= _STILL_RAD))
        and bool(np.all(np.abs(now.dq_rad_s) <= _STILL_RAD_S))
    )


log = logging.getLogger(__name__)

FLUSH_EVERY_S = 0.5
"""Period of flushes [s of machine time]; a killed process loses the messages since the last one."""
BATCH_EVERY_S = 0.1
"""Period at which the thread writes [s]; waking it for each message would cost the run more than the writing."""
QUEUE_LENGTH = 1024
"""Number of messages that may wait for the disk: 5 s of a live run."""


@dataclass(frozen=True)
class _Item:
    topic: Topic[Any]
    log_ns: int
    message: Message | bytes | Callable[[], Message]
    """Encoded if it is from another process; a function returns the message on the writer's thread."""


class Recorder:
    """Takes messages from any thread and writes them to a file. Use as a context manager."""

    def __init__(
        self,
        path: Path,
        now_ns: Callable[[], int],
        metadata: Mapping[str, Mapping[str, str]],
        *,
        waits: bool,
        failed: Callable[[str], object] = lambda why: None,
        edges_world: Float64Array = NO_EDGES,
    ) -> None:
        """`now_ns` is the run's clock. When the disk is slow, `put` waits if `waits`, else it drops and counts.

        `failed` is called with the reason, on any thread, when the recording will not be whole. `edges_world` are those
        of the believed fixtures (E, 2, 3) [m].
        """
        self._path = path
        self._now_ns = now_ns
        self._metadata = metadata
        self._waits = waits
        self._failed = failed
        self._edges_world = edges_world
        self._queue: queue.Queue[_Item] = queue.Queue(QUEUE_LENGTH)
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._last_picture_ns: int | None = None
        self._clocks: dict[str, str] = {}
        self._skipped = Counter[str]()
        self._resting = RestThinning()
        self._topics = set[str]()
        self._undecodable = LogRate()
        self._closed = False
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)

    def __enter__(self) -> "Recorder":
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._closed = True
        self._ending.set()
        self._thread.join(DISK_TIMEOUT_S)
        if self._thread.is_alive():
            log.warning("recording_slow: %s is not complete: the disk does not respond", self._path)
            self._failed(NO_ANSWER)

    def put(self, topic: Topic[Any], message: Message | bytes | Callable[[], Message]) -> None:
        """Record a message, which must not change afterwards; returns at once unless the recorder `waits`.

        A function is called on the writer's thread and returns the message.
        """
        if self._closed:
            return
        log_ns = self._now_ns()
        if not self._clocks:
            self._clocks = {"run_ns": str(log_ns), "real_ns": str(time.time_ns())}
        self._topics.add(topic.name)
        if topic.row in PICTURE_ROWS:
            with self._lock:
                last_ns = self._last_picture_ns
                if last_ns is not None and 0 <= log_ns - last_ns < 1e9 / IMAGES_PER_S:
                    self._skipped[topic.name] += 1
                    return
                self._last_picture_ns = log_ns
        try:
            self._queue.put(_Item(topic, log_ns, message), self._waits, DISK_TIMEOUT_S)
        except queue.Full:
            if self._waits:
                log.warning("recording_failed: %s: the disk does not respond; the run continues without it", self._path)
                self._closed = True
                self._failed(NO_ANSWER)

    def has(self, topic: Topic[Any]) -> bool:
        """Whether any message of a topic was passed to the recorder."""
        return topic.name in self._topics

    def _write_all(self) -> None:
        try:
            writer = RecordingWriter(self._path, self._metadata, edges_world=self._edges_world)
        except OSError as error:
            self._give_up(error)
            return
        try:
            self._write_until_end(writer)
            lost = Counter(writer.lost) - self._skipped
            writer.add_metadata("thinned", {name: str(number) for name, number in self._skipped.items()})
            writer.add_metadata("lost", {name: str(number) for name, number in lost.items()})
            writer.close()
        except Exception as error:  # any error ends the recording only; the run continues
            writer.abandon()
            self._give_up(error)

    def _write_until_end(self, writer: RecordingWriter) -> None:
        flush_at_s = time.monotonic() + FLUSH_EVERY_S
        ending = noted = False
        # If this thread were preempted while it holds the interpreter's lock, this process would send no heartbeat.
        urgency = never_urgent if self._waits else BoundedUrgency()
        while not ending:
            urgency(True)
            ending = self._ending.wait(BATCH_EVERY_S)
            # Only the messages that wait now, so that later ones do not delay the flush.
            for _ in range(self._queue.qsize()):
                if not noted:
                    writer.add_metadata(CLOCK, self._clocks)
                    noted = True
                self._write(writer, self._queue.get_nowait())
            if time.monotonic() >= flush_at_s:
                writer.flush()
                flush_at_s = time.monotonic() + FLUSH_EVERY_S

    def _write(self, writer: RecordingWriter, item: _Item) -> None:
        message = item.message
        try:
            if isinstance(message, bytes):
                message = codec.decode(message, item.topic.type)
            elif not isinstance(message, Message):
                message = message()
        except CommunicationError as error:
            if number := self._undecodable.due(item.topic.name):
                log.warning("messages on %s not recorded: %d, the last: %s", item.topic.name, number, error)
            return
        if isinstance(message, RobotState) and not self._resting.keeps(item.topic.name, item.log_ns, message):
            self._skipped[item.topic.name] += 1
            return
        writer.add(item.topic, item.log_ns, message)

    def _give_up(self, error: Exception) -> None:
        log.warning("recording_failed: %s: %s; the run continues without a recording", self._path, error)
        self._closed = True
        self._failed(reason_of(error))
        with contextlib.suppress(queue.Empty):  # release callers that wait for space in the queue
            while True:
                self._queue.get_nowait()
