"""What the parts of one zenoh transport share: session, the way to the event loop, and what was refused."""

import asyncio
import logging
import os
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import zenoh

from dlokit.errors import CommunicationError

log = logging.getLogger(__name__)


class LoopDoor:
    """Runs functions on the loop, asked from any thread.

    As `loop.call_soon_threadsafe`, in two thirds of the time: it wakes the loop once for a burst, and the loop reads
    one byte.
    """

    def __init__(self) -> None:
        """On the loop's thread, while it runs."""
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[Callable[..., object], tuple[Any, ...]]] = deque()
        self._lock = threading.Lock()
        self._knocked = False
        self._closed = False
        self._hears, self._knocks = os.pipe()
        os.set_blocking(self._hears, False)
        os.set_blocking(self._knocks, False)
        self._loop.add_reader(self._hears, self._open)

    def call(self, function: Callable[..., object], *args: Any) -> None:
        """Run a function on the loop soon, in the order of the calls; nothing when the door is closed."""
        self._waiting.append((function, args))
        with self._lock:
            if not self._knocked and not self._closed:
                self._knocked = True
                os.write(self._knocks, b"!")

    def close(self) -> None:
        """Run nothing more. On the loop's thread."""
        with self._lock:
            self._closed = True
            self._loop.remove_reader(self._hears)
            os.close(self._hears)
            os.close(self._knocks)

    def _open(self) -> None:
        os.read(self._hears, 16)
        # First this: whoever comes from now on knocks again, and whoever came before is in the queue.
        self._knocked = False
        for _ in range(len(self._waiting)):  # not for those who come meanwhile: the loop has others to serve
            function, args = self._waiting.popleft()
            try:
                function(*args)
            except Exception:  # one function's mistake must keep none of the others from the loop
                log.exception("%r raised", function)


class Refusals:
    """By topic and kind of error. Any thread may note one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, topic: str, error: CommunicationError) -> None:
        """Count a message, or a peer, that cannot be understood; the first of its kind is logged."""
        key = (topic, type(error).__name__)
        with self._lock:
            self._counts[key] += 1
            first = self._counts[key] == 1
        if first:
            log.error("messages on %s are dropped: %s", topic, error)

    @property
    def counts(self) -> Mapping[tuple[str, str], int]:
        """How many, by topic and name of the error."""
        with self._lock:
            return dict(self._counts)


@dataclass(frozen=True)
class Connection:
    """What the topics of one process share."""

    session: zenoh.Session
    door: LoopDoor
    refusals: Refusals
