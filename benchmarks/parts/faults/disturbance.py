"""A bus with injected faults: delayed or lost messages, between zenoh and the transport.

A file, written by the bench during a run, selects the fault. So all processes of the run are disturbed at the same
time, including those started later.
"""

import enum
import logging
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import zenoh

from dlokit.communication import topics
from dlokit.communication.zenoh.session import ZenohConfig, open_session

log = logging.getLogger(__name__)

FILE_NAME = "disturbance"
LATE_S = 0.5
LOOK_EVERY_S = 0.01
FEEDBACK = tuple(f"topic/{topic.name}" for topic in (topics.ARM_STATE, topics.ROBOT_STATE))
"""Key prefixes of the feedback that arms publish."""


PICTURES = "call/cell/capture"
"""Key prefix of the calls for pictures."""
UNANSWERED_FILE = "unanswered"
"""Beside the file of the disturbance: when the first call for pictures was not answered, on the machine's clock [s]."""


class Disturbance(enum.Enum):
    """The kinds of disturbance."""

    NONE = ""
    LATE = "late"
    NO_FEEDBACK = "no_feedback"
    """The feedback of an arm does not reach its driver, nor its published state another arm; all else arrives."""
    NO_PICTURES = "no_pictures"
    """The cell's cameras do not answer; all else arrives."""


class Line:
    """The outgoing messages of one process, in order: sent at once, or delayed while the disturbance is active."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._lock = threading.Lock()
        self._looked_s = 0.0
        self._kind = Disturbance.NONE
        self._late: queue.Queue[tuple[float, Callable[[], object]]] = queue.Queue()
        self._under_way = 0
        threading.Thread(target=self._deliver, name="late messages", daemon=True).start()

    def send(self, how: Callable[[], object]) -> None:
        """Send now, or later; callable from any thread."""
        with self._lock:
            late_s = LATE_S if self._now() is Disturbance.LATE else 0.0
            if late_s > 0.0 or self._under_way > 0:  # keeps the order of messages that are still delayed
                self._under_way += 1
                self._late.put((time.monotonic() + late_s, how))
                return
        how()

    def is_now(self, kind: Disturbance) -> bool:
        """Whether the bus is disturbed in this way now."""
        with self._lock:
            return self._now() is kind

    def drops_pictures(self) -> bool:
        """Whether calls for pictures are not answered now; the time of the first is noted in a file."""
        drops, noted = self.is_now(Disturbance.NO_PICTURES), self._file.with_name(UNANSWERED_FILE)
        if drops and not noted.exists():
            noted.write_text(str(time.monotonic()), encoding="ascii")
        return drops

    def _now(self) -> Disturbance:
        now_s = time.monotonic()
        if now_s - self._looked_s > LOOK_EVERY_S:
            self._looked_s = now_s
            self._kind = kind_in(self._file)
        return self._kind

    def _deliver(self) -> None:
        while True:
            due_s, how = self._late.get()
            time.sleep(max(0.0, due_s - time.monotonic()))
            try:
                how()
            except zenoh.ZError as error:  # its session may have been closed
                log.debug("a delayed message could not be sent: %s", error)
            with self._lock:
                self._under_way -= 1


def disturb(folder: Path, kind: Disturbance) -> None:
    """Disturb the bus of the run in `folder`, from now on; the run must have been started for it."""
    part = folder / f"{FILE_NAME}.part"
    part.write_text(kind.value, encoding="ascii")
    part.replace(folder / FILE_NAME)


def disturbed_process(file: Path) -> tuple[str, ...]:
    """The command of a process of a run whose bus is disturbed as the file specifies."""
    return (sys.executable, str(Path(__file__).with_name("disturbed_process.py")), str(file))


def kind_in(file: Path) -> Disturbance:
    """The current kind of disturbance."""
    try:
        return Disturbance(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return Disturbance.NONE


def disturbed_by(file: Path) -> Callable[[ZenohConfig], zenoh.Session]:
    """A function that opens sessions that are disturbed as the file specifies."""

    def open_disturbed(config: ZenohConfig) -> zenoh.Session:
        session = _Session(open_session(config), Line(file))
        return cast(zenoh.Session, session)

    return open_disturbed


def first_unanswered_s(folder: Path) -> float | None:
    """When the first call for pictures was not answered, on the machine's clock [s]; None: all were."""
    try:
        return float((folder / UNANSWERED_FILE).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


class _Session:
    """A session that sends all messages over the line."""

    def __init__(self, session: zenoh.Session, line: Line) -> None:
        self._session = session
        self._line = line
        self._unanswered: dict[bytes, Any] = {}  # the handlers of calls that are never sent, by their ids

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def declare_publisher(self, key: str, **how: Any) -> Any:
        return _Publisher(self._session.declare_publisher(key, **how), self._line)

    def declare_subscriber(self, key: str, handler: Any) -> Any:
        if not key.startswith(FEEDBACK):
            return self._session.declare_subscriber(key, handler)
        if not callable(handler):  # a ring of samples, which its reader takes
            return _Subscriber(self._session.declare_subscriber(key, handler), self._line)

        def hand_on(sample: Any) -> None:
            if not self._line.is_now(Disturbance.NO_FEEDBACK):
                handler(sample)

        return self._session.declare_subscriber(key, hand_on)

    def declare_queryable(self, key: str, handler: Callable[[Any], None]) -> Any:
        return self._session.declare_queryable(key, lambda query: handler(_Query(query, self._line)))

    def put(self, key: str, payload: Any, **how: Any) -> None:
        if key.startswith("cancel/") and (handler := self._unanswered.pop(payload, None)) is not None:
            handler.drop()  # a device that does not answer has nothing to cancel
            return
        self._line.send(lambda: self._session.put(key, payload, **how))

    def get(self, key: str, handler: Any, **how: Any) -> None:
        if key.startswith(PICTURES) and self._line.drops_pictures():
            self._unanswered[how["attachment"]] = handler
            return
        self._line.send(lambda: self._session.get(key, handler, **how))


class _Publisher:
    def __init__(self, publisher: Any, line: Line) -> None:
        self._publisher = publisher
        self._line = line

    def put(self, payload: Any, **how: Any) -> None:
        self._line.send(lambda: self._publisher.put(payload, **how))


class _Subscriber:
    """A subscriber with a ring of samples: its `handler` returns only those that are not dropped."""

    def __init__(self, subscriber: Any, line: Line) -> None:
        self._subscriber = subscriber
        self._line = line

    @property
    def handler(self) -> "_Subscriber":
        return self

    def __iter__(self) -> Iterator[Any]:
        return (sample for sample in self._subscriber.handler if not self._line.is_now(Disturbance.NO_FEEDBACK))

    def try_recv(self) -> Any:
        while (sample := self._subscriber.handler.try_recv()) is not None:
            if not self._line.is_now(Disturbance.NO_FEEDBACK):
                return sample
        return None


class _Query:
    def __init__(self, query: zenoh.Query, line: Line) -> None:
        self._query = query
        self._line = line

    def __getattr__(self, name: str) -> Any:
        return getattr(self._query, name)

    def reply(self, key: Any, payload: Any, **how: Any) -> None:
        self._line.send(lambda: self._query.reply(key, payload, **how))

    def drop(self) -> None:
        self._line.send(self._query.drop)
