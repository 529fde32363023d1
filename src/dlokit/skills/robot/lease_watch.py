"""Who looks whether the commander's lease still runs: the loop in lockstep, a thread of its own when live."""

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

from dlokit.communication.urgency import make_urgent
from dlokit.skills.robot.lease import LeaseKeeper

log = logging.getLogger(__name__)

LOOK_S = 0.02
"""Longest time between two looks while a lease runs, and between two orders to brake once it has run out [s]."""
SHORTEST_S = 0.001
"""Shortest time between two looks [s]."""
OVERSLEPT_S = 0.02
"""Whoever looks this much later than it meant to [s] has not been told what came meanwhile: it looks once more."""


class LeaseWatch(Protocol):
    """Tells of a lease that has run out, again and again until it runs once more or is given back."""

    def begin(self, keeper: LeaseKeeper, ran_out: Callable[[], None]) -> None:
        """Begin to look, unless it does already. `ran_out` may be called on another thread, and returns at once."""
        ...

    def end(self) -> None:
        """Look no more."""
        ...


class LoopWatch:
    """Looks on the event loop, and so not while that is busy."""

    def __init__(self) -> None:
        self._task: asyncio.Task[None] | None = None

    def begin(self, keeper: LeaseKeeper, ran_out: Callable[[], None]) -> None:
        """Look until nobody has the lease."""
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._look(keeper, ran_out), name="robot lease")

    def end(self) -> None:
        """Look no more."""
        if self._task is not None:
            self._task.cancel()

    async def _look(self, keeper: LeaseKeeper, ran_out: Callable[[], None]) -> None:
        while keeper.taken:
            if keeper.lost:
                ran_out()
            await asyncio.sleep(LOOK_S)


class ThreadWatch:
    """Looks from a thread of its own, on the machine's monotonic clock, at the moment when the lease may run out."""

    def __init__(self) -> None:
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, keeper: LeaseKeeper, ran_out: Callable[[], None]) -> None:
        """Look until `end`."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._look, args=(keeper, ran_out), name="lease watch", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Look no more."""
        self._over.set()

    def _look(self, keeper: LeaseKeeper, ran_out: Callable[[], None]) -> None:
        make_urgent()
        late = False
        while True:
            # Once: a machine so busy that it wakes nobody in time must not keep the arm moving.
            again = late and keeper.lost
            if keeper.lost and not again:
                self._tell(ran_out)
            wait_s = SHORTEST_S if again else _next_look_s(keeper)
            began_s = time.monotonic()
            if self._over.wait(wait_s):
                return
            late = not again and time.monotonic() - began_s > wait_s + OVERSLEPT_S

    @staticmethod
    def _tell(ran_out: Callable[[], None]) -> None:
        try:
            ran_out()
        except Exception:  # the next look tells again: a watch that has ended would leave the arm moving for ever
            log.exception("whoever is told of a lease that has run out raised")


def _next_look_s(keeper: LeaseKeeper) -> float:
    left_s = keeper.left_s
    return LOOK_S if left_s <= 0.0 else min(max(left_s, SHORTEST_S), LOOK_S)
