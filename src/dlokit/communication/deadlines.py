"""Who looks whether something is over that must be put off in time: the loop in lockstep, a thread when live."""

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

from dlokit.communication.urgency import make_urgent

log = logging.getLogger(__name__)

LOOK_S = 0.02
"""Longest time between two looks, and between two tellings that something is over [s]."""
SHORTEST_S = 0.001
"""Shortest time between two looks [s]."""
OVERSLEPT_S = 0.02
"""Whoever looks this much later than it meant to [s] has not been told what came meanwhile: it looks once more."""


class Deadline(Protocol):
    """Something that is over after a time unless it is put off: a lease that is renewed, feedback that is fresh."""

    @property
    def left_s(self) -> float:
        """Time until it is over [s], 0 or less from then on; inf while it cannot be over. Any thread may ask."""
        ...


class Watch(Protocol):
    """Tells of what is over, again and again until it is put off or no more looked at."""

    def begin(self, deadline: Deadline, over: Callable[[], None]) -> None:
        """Look at it too, unless it does already. `over` may be called on another thread, and returns at once."""
        ...

    def end(self, deadline: Deadline) -> None:
        """Look at it no more; its `over` is not called after this."""
        ...

    def close(self) -> None:
        """Look at nothing more."""
        ...


class LoopWatch:
    """Looks on the event loop, and so not while that is busy; only while something can be over."""

    def __init__(self) -> None:
        self._over: dict[Deadline, Callable[[], None]] = {}
        self._task: asyncio.Task[None] | None = None

    def begin(self, deadline: Deadline, over: Callable[[], None]) -> None:
        """Look at it too."""
        self._over[deadline] = over
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._look(), name="deadlines")

    def end(self, deadline: Deadline) -> None:
        """Look at it no more."""
        self._over.pop(deadline, None)

    def close(self) -> None:
        """Look at nothing more."""
        if self._task is not None:
            self._task.cancel()

    async def _look(self) -> None:
        while any(deadline.left_s < math.inf for deadline in self._over):
            for deadline, over in list(self._over.items()):
                if deadline.left_s <= 0.0:
                    over()
            await asyncio.sleep(LOOK_S)


class ThreadWatch:
    """Looks from a thread of its own, on the machine's monotonic clock, at the moment when something may be over."""

    def __init__(self) -> None:
        self._over: dict[Deadline, Callable[[], None]] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, deadline: Deadline, over: Callable[[], None]) -> None:
        """Look at it too."""
        with self._lock:
            self._over[deadline] = over
            if self._thread is None:
                self._thread = threading.Thread(target=self._look, name="deadlines", daemon=True)
                self._thread.start()

    def end(self, deadline: Deadline) -> None:
        """Look at it no more."""
        with self._lock:
            self._over.pop(deadline, None)

    def close(self) -> None:
        """Look at nothing more."""
        self._closed.set()

    def _look(self) -> None:
        make_urgent()
        late = False
        while True:
            with self._lock:
                looked_at = dict(self._over)
            is_over = [deadline for deadline in looked_at if deadline.left_s <= 0.0]
            # Once: a machine so busy that it wakes nobody in time must not keep the arm moving.
            again = late and bool(is_over)
            if not again:
                for deadline in is_over:
                    self._tell(deadline)
            wait_s = SHORTEST_S if again else min(map(_next_look_s, looked_at), default=LOOK_S)
            began_s = time.monotonic()
            if self._closed.wait(wait_s):
                return
            late = not again and time.monotonic() - began_s > wait_s + OVERSLEPT_S

    def _tell(self, deadline: Deadline) -> None:
        with self._lock:  # an order to brake that came after `end` would stop the next motion
            if (over := self._over.get(deadline)) is None:
                return
            try:
                over()
            except Exception:  # the next look tells again: a watch that has ended would leave an arm moving for ever
                log.exception("whoever is told that something is over raised")


def _next_look_s(deadline: Deadline) -> float:
    left_s = deadline.left_s
    return LOOK_S if left_s <= 0.0 else min(max(left_s, SHORTEST_S), LOOK_S)
