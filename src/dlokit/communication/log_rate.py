"""Limits the rate of log lines about other processes: a peer that floods the bus cannot fill a log or a terminal."""

import threading
import time
from collections import Counter
from collections.abc import Callable

PERIOD_S = 10.0
"""Shortest time between two log lines of one kind [s]."""


class LogRate:
    """Decides when a line of a kind is logged: the first at once, later ones at most once in `PERIOD_S`."""

    def __init__(self, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._monotonic_s = monotonic_s
        self._lock = threading.Lock()
        self._counts = Counter[str]()
        self._logged_s: dict[str, float] = {}

    def due(self, kind: str) -> int:
        """Count an event, on any thread; returns the number since the last line, 0 when none is to be logged now.

        `kind` is one of few names that this process chooses, not a peer.
        """
        with self._lock:
            self._counts[kind] += 1
            now_s = self._monotonic_s()
            if now_s - self._logged_s.get(kind, -PERIOD_S) < PERIOD_S:
                return 0
            self._logged_s[kind] = now_s
            return self._counts.pop(kind)
