"""Which threads have the machine before all others: the few on which it depends how soon an arm brakes.

Real-time threads of Linux, where the system allows them; elsewhere, and where it does not, nothing changes.
"""

import contextlib
import gc
import os
import threading
import time
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager
from typing import Protocol

SIGNS_PRIORITY = 5
"""Of threads that only pass signs of life and orders on; low among real-time threads, so that a driver's own come
first."""
WORK_PRIORITY = 3
"""Of threads that compute as well: no sign of life waits for them."""
MOST_OF_A_CORE = 0.5
"""Whoever computes longer than this share of the time leaves the machine to the others."""
WINDOW_S = 0.5
"""Time over which that share is taken [s]."""
REST_S = 1.0
"""How long it then leaves it to them [s]."""


class Urgency(Protocol):
    """Told again and again by the thread that calls it whether it is in a hurry."""

    def __call__(self, wanted: bool, /) -> None:
        """`wanted`: from now on, the calling thread would have the machine before others."""
        ...


def never_urgent(wanted: bool) -> None:
    """For lockstep, where nobody waits for the machine."""


class BoundedUrgency:
    """The calling thread has the machine before others while it wants to, and takes little of it.

    One that takes more than `MOST_OF_A_CORE` could starve the others: it is ordinary for a while.
    """

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        used_s: Callable[[], float] = time.thread_time,
        grant: Callable[[bool], object] | None = None,
    ) -> None:
        """`now_s` is the machine's clock, `used_s` what the thread has computed [s]; `grant` sets its priority."""
        self._now_s, self._used_s, self._grant = now_s, used_s, grant or _grant
        self._urgent = self._spent = False
        self._window_began_s = self._used_before_s = 0.0

    def __call__(self, wanted: bool) -> None:
        """As `Urgency`; it costs less than a microsecond while nothing changes."""
        if not wanted:
            self._spent = False
        elif self._urgent:
            self._spent = self._too_much()
        elif self._spent:
            self._spent = self._now_s() - self._window_began_s < REST_S
        self._set(wanted and not self._spent)

    def _set(self, urgent: bool) -> None:
        if urgent != self._urgent:
            self._urgent = urgent
            self._grant(urgent)
            self._begin_window()

    def _begin_window(self) -> None:
        self._window_began_s, self._used_before_s = self._now_s(), self._used_s()

    def _too_much(self) -> bool:
        window_s = self._now_s() - self._window_began_s
        if window_s < WINDOW_S:
            return False
        used_s = self._used_s() - self._used_before_s
        self._begin_window()
        return used_s > MOST_OF_A_CORE * window_s


def make_urgent(priority: int = SIGNS_PRIORITY) -> bool:
    """Let the calling thread have the machine before others, where this is allowed; whether it is.

    Threads and processes that it starts are ordinary ones.
    """
    return _set_policy(lambda: (os.SCHED_RR | os.SCHED_RESET_ON_FORK, priority))


def may_be_urgent() -> bool:
    """Whether this system lets a thread have the machine before others."""
    allowed: list[bool] = []
    trying = threading.Thread(target=lambda: allowed.append(make_urgent()))
    trying.start()
    trying.join()
    return allowed == [True]


@asynccontextmanager
async def garbage_frozen() -> AsyncGenerator[None]:
    """Keep the garbage collector away from what this process has loaded before.

    There is hardly any garbage in it, and a full collection holds the interpreter's lock for 0.1 to 0.7 s: no heartbeat
    is sent meanwhile, and no order passed on.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def threads_urgent() -> Generator[None]:
    """Threads that are started meanwhile, by the calling one, are urgent, and so are those that they start.

    For threads of a library, which cannot ask for themselves. Nothing may start a process meanwhile.
    """
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
    except (OSError, AttributeError):
        before = None
    changed = before is not None and _set_policy(lambda: (os.SCHED_RR, SIGNS_PRIORITY))
    try:
        yield
    finally:
        if changed and before is not None:
            with contextlib.suppress(OSError):  # giving back is always allowed
                os.sched_setscheduler(0, *before)


def _grant(urgent: bool) -> None:
    if urgent:
        make_urgent(WORK_PRIORITY)
    else:
        # The flag stays: who may not do everything may not take it away, and would be refused.
        _set_policy(lambda: (os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, 0))


def _set_policy(wanted: Callable[[], tuple[int, int]]) -> bool:
    """Policy and priority of the calling thread; `wanted` names what other systems than Linux lack."""
    with contextlib.suppress(OSError, AttributeError):  # not allowed; not Linux
        policy, priority = wanted()
        os.sched_setscheduler(0, policy, os.sched_param(priority))
        return True
    return False
