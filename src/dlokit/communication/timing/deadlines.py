"""Deadlines that must be put off in time, and who watches them: the event loop in lockstep, a thread when live."""

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

from dlokit.communication.timing.urgency import make_urgent

log = logging.getLogger(__name__)

LOOK_S = 0.02
"""Longest time between two looks, and between two calls of `expired` [s]."""
SHORTEST_S = 0.001
"""Shortest time between two looks [s]."""
OVERSLEPT_S = 0.02
"""A thread that wakes this much later than it meant to [s] has not heard what arrived meanwhile: it looks once more."""


class Deadline(Protocol):
    """Something that expires unless it is put off: a lease that is renewed, feedback that is fresh."""

    @property
    def left_s(self) -> float:
        """Time until it expires [s], 0 or less from then on; inf while it cannot. Any thread may ask."""
        ...


class Watch(Protocol):
    """Calls back when a deadline has expired, again and again until it is put off or no longer watched.

    A deadline that raises when it is asked counts as expired: the arm brakes, and the log says why.
    """

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Watch it too, unless it is watched already. `expired` may be called on another thread; it returns at once."""
        ...

    def end(self, deadline: Deadline) -> None:
        """Watch it no longer; its `expired` is not called after this."""
        ...

    def close(self) -> None:
        """Watch nothing any more."""
        ...


class LoopWatch:
    """Watches on the event loop, and so not while that is busy; only while a deadline can expire."""

    def __init__(self) -> None:
        self._watched: dict[Deadline, Callable[[], None]] = {}
        self._task: asyncio.Task[None] | None = None

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Watch it too."""
        self._watched[deadline] = expired
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._look(), name="deadlines")

    def end(self, deadline: Deadline) -> None:
        """Watch it no longer."""
        self._watched.pop(deadline, None)

    def close(self) -> None:
        """Watch nothing any more."""
        if self._task is not None:
            self._task.cancel()

    async def _look(self) -> None:
        while any(_left_s(deadline) < math.inf for deadline in self._watched):
            for deadline, expired in list(self._watched.items()):
                if _left_s(deadline) <= 0.0:
                    expired()
            await asyncio.sleep(LOOK_S)


class ThreadWatch:
    """Watches from a thread of its own, on the machine's monotonic clock; wakes when a deadline may expire."""

    def __init__(self) -> None:
        self._watched: dict[Deadline, Callable[[], None]] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, deadline: Deadline, expired: Callable[[], None]) -> None:
        """Watch it too."""
        with self._lock:
            self._watched[deadline] = expired
            if self._thread is None:
                self._thread = threading.Thread(target=self._look, name="deadlines", daemon=True)
                self._thread.start()

    def end(self, deadline: Deadline) -> None:
        """Watch it no longer."""
        with self._lock:
            self._watched.pop(deadline, None)

    def close(self) -> None:
        """Watch nothing any more."""
        self._closed.set()

    def _look(self) -> None:
        make_urgent()
        late = False
        while True:
            with self._lock:
                watched = list(self._watched)
            left_s = {deadline: _left_s(deadline) for deadline in watched}
            expired = [deadline for deadline, left in left_s.items() if left <= 0.0]
            # Once: a machine so busy that it wakes nobody in time must not keep the arm moving.
            again = late and bool(expired)
            if not again:
                for deadline in expired:
                    self._tell(deadline)
            wait_s = SHORTEST_S if again else min(map(_next_look_s, left_s.values()), default=LOOK_S)
            began_s = time.monotonic()
            if self._closed.wait(wait_s):
                return
            late = not again and time.monotonic() - began_s > wait_s + OVERSLEPT_S

    def _tell(self, deadline: Deadline) -> None:
        try:
            with self._lock:  # an order to brake that came after `end` would stop the next motion
                if (expired := self._watched.get(deadline)) is not None:
                    expired()
        except Exception:  # the next look tells again: a watch that has ended would leave an arm moving for ever
            log.exception("whoever is told that a deadline has expired raised")


def _left_s(deadline: Deadline) -> float:
    try:
        return deadline.left_s
    except Exception:  # whatever it is: nobody knows any more whether the arm may move, so it brakes
        log.exception("a deadline could not say how much time is left; it counts as expired")
        return 0.0


def _next_look_s(left_s: float) -> float:
    return LOOK_S if left_s <= 0.0 else min(max(left_s, SHORTEST_S), LOOK_S)
