"""Deadlines and the watchdogs that check them: on the event loop in lockstep, on a thread when live."""

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

from dlokit.communication.timing.urgency import make_urgent

log = logging.getLogger(__name__)

CHECK_PERIOD_S = 0.02
"""Longest time between two checks, and between two calls of `expired` [s]."""
SHORTEST_WAIT_S = 0.001
"""Shortest time between two checks [s]."""
LATE_WAKE_S = 0.02
"""A thread that wakes later than planned by this much [s] may have missed a renewal: it checks once more."""


class Deadline(Protocol):
    """A point in time that expires unless it is renewed, e.g. of a lease or of the driver's feedback."""

    @property
    def left_s(self) -> float:
        """Time until it expires [s]; 0 or less once expired, inf while it cannot expire. Thread-safe."""
        ...


class DeadlineWatchdog(Protocol):
    """Calls back when a deadline has expired, repeatedly until the deadline is renewed or removed.

    A deadline that raises an error counts as expired: the arm brakes, and the log has the error.
    """

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Add a deadline. `expired` may be called on another thread; it must return at once."""
        ...

    def end(self, deadline: Deadline) -> None:
        """Remove a deadline; its `expired` is not called after this returns."""
        ...

    def close(self) -> None:
        """Stop checking all deadlines."""
        ...


class LoopWatchdog:
    """Checks on the event loop, hence not while the loop is busy, and only while a deadline can expire."""

    def __init__(self) -> None:
        self._watched: dict[Deadline, Callable[[], None]] = {}
        self._task: asyncio.Task[None] | None = None

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Add a deadline."""
        self._watched[deadline] = expired
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._check(), name="deadlines")

    def end(self, deadline: Deadline) -> None:
        """Remove a deadline."""
        self._watched.pop(deadline, None)

    def close(self) -> None:
        """Stop checking all deadlines."""
        if self._task is not None:
            self._task.cancel()

    async def _check(self) -> None:
        while any(_left_s(deadline) < math.inf for deadline in self._watched):
            for deadline, expired in list(self._watched.items()):
                if _left_s(deadline) <= 0.0:
                    expired()
            await asyncio.sleep(CHECK_PERIOD_S)


class ThreadWatchdog:
    """Checks on its own thread and the machine's monotonic clock; wakes when a deadline may expire."""

    def __init__(self) -> None:
        self._watched: dict[Deadline, Callable[[], None]] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Add a deadline."""
        with self._lock:
            self._watched[deadline] = expired
            if self._thread is None:
                self._thread = threading.Thread(target=self._check, name="deadlines", daemon=True)
                self._thread.start()

    def end(self, deadline: Deadline) -> None:
        """Remove a deadline."""
        with self._lock:
            self._watched.pop(deadline, None)

    def close(self) -> None:
        """Stop checking all deadlines."""
        self._closed.set()

    def _check(self) -> None:
        make_urgent()
        late = False
        while True:
            with self._lock:
                watched = list(self._watched)
            left_s = {deadline: _left_s(deadline) for deadline in watched}
            expired = [deadline for deadline, left in left_s.items() if left <= 0.0]
            # Only once: on a machine so busy that threads always wake late, the arm must still brake.
            again = late and bool(expired)
            if not again:
                for deadline in expired:
                    self._notify(deadline)
            wait_s = SHORTEST_WAIT_S if again else min(map(_next_check_s, left_s.values()), default=CHECK_PERIOD_S)
            began_s = time.monotonic()
            if self._closed.wait(wait_s):
                return
            late = not again and time.monotonic() - began_s > wait_s + LATE_WAKE_S

    def _notify(self, deadline: Deadline) -> None:
        try:
            with self._lock:  # a brake command after `end` would stop the next motion
                if (expired := self._watched.get(deadline)) is not None:
                    expired()
        except Exception:  # the next check notifies again; if the thread ended here, nothing would stop the arm
            log.exception("the callback for an expired deadline raised an error; it is called again")


def _left_s(deadline: Deadline) -> float:
    try:
        return deadline.left_s
    except Exception:  # it is unknown whether the arm may still move, so it brakes
        log.exception("a deadline failed to return its remaining time; it counts as expired")
        return 0.0


def _next_check_s(left_s: float) -> float:
    return CHECK_PERIOD_S if left_s <= 0.0 else min(max(left_s, SHORTEST_WAIT_S), CHECK_PERIOD_S)
