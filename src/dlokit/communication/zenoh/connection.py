"""What the parts of one zenoh transport share: the session, the event loop, and the count of refused messages."""

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import zenoh

from dlokit.errors import CommunicationError

log = logging.getLogger(__name__)


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
    loop: asyncio.AbstractEventLoop
    """Zenoh calls back on threads of its own; they hand over with `call_soon_threadsafe`."""
    refusals: Refusals
