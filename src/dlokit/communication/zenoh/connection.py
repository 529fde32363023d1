"""State shared by the parts of one zenoh transport: session, event loop, and the count of refused messages."""

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
    """Counts of refused messages by topic and kind of error. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, topic: str, error: CommunicationError) -> None:
        """Count a message or peer that this version cannot decode; the first of each kind is logged."""
        key = (topic, type(error).__name__)
        with self._lock:
            self._counts[key] += 1
            first = self._counts[key] == 1
        if first:
            log.error("messages on %s dropped: %s", topic, error)

    @property
    def counts(self) -> Mapping[tuple[str, str], int]:
        """Number of refused messages by topic and name of the error."""
        with self._lock:
            return dict(self._counts)


@dataclass(frozen=True)
class Connection:
    """The session, event loop and refusal counts that the topics of one process share."""

    session: zenoh.Session
    loop: asyncio.AbstractEventLoop
    """Callbacks on zenoh's threads pass their results to it with `call_soon_threadsafe`."""
    refusals: Refusals
