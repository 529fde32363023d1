"""Threads: real-time priority for the few that determine how soon an arm brakes, and one alone for linear algebra.

An urgent thread is scheduled before ordinary ones (`SCHED_RR` on Linux). Where the system does not allow this, threads
keep their ordinary priority.
"""

import contextlib
import gc
import os
import threading
import time
from collections.abc import AsyncGenerator, Callable, Generator
from contextlib import asynccontextmanager, contextmanager
from typing import Protocol

HEARTBEAT_PRIORITY = 5
"""Real-time priority of threads that only pass on heartbeats and commands; low, so that a driver's threads precede
them."""
WORK_PRIORITY = 3
"""Real-time priority of threads that also compute: no heartbeat waits for them."""
LARGEST_CPU_FRACTION = 0.5
"""Fraction of one core above which a thread gets ordinary priority for a while."""
WINDOW_S = 0.5
"""Time over which that fraction is measured [s]."""
REST_S = 1.0
"""Duration of this ordinary priority [s]."""


class Urgency(Protocol):
    """Requests or releases real-time priority for the calling thread, which calls it periodically."""

    def __call__(self, wanted: bool, /) -> None:
        """Request (True) or release (False) real-time priority for the calling thread."""
        ...


def never_urgent(wanted: bool) -> None:
    """Leave the priority as it is: in lockstep, nothing depends on the machine's time."""


class BoundedUrgency:
    """Real-time priority for a thread that needs little of a core.

    A thread that uses more than a fraction of a core, by default `LARGEST_CPU_FRACTION`, is ordinary for `REST_S`, so
    that it cannot starve other threads.
    """

    def __init__(
        self,
        now_s: Callable[[], float] = time.monotonic,
        used_s: Callable[[], float] = time.thread_time,
        grant: Callable[[bool], object] | None = None,
        priority: int = WORK_PRIORITY,
        largest_fraction: float = LARGEST_CPU_FRACTION,
    ) -> None:
        """`now_s` is the machine's clock, `used_s` the thread's CPU time [s]; `grant` sets its `priority`."""
        self._largest_fraction = largest_fraction
        self._now_s, self._used_s = now_s, used_s
        self._grant = grant or (lambda wanted: make_urgent(priority if wanted else 0))
        self._urgent = self._spent = False
        self._window_began_s = self._used_before_s = 0.0

    def __call__(self, wanted: bool) -> None:
        """As `Urgency`; takes less than a microsecond while nothing changes."""
        now_s, urgent = self._now_s(), self._urgent
        if not wanted:
            self._spent = False
        elif self._spent:
            self._spent = now_s - self._window_began_s < REST_S
        elif urgent and now_s - self._window_began_s >= WINDOW_S:
            used_s = self._used_s()
            self._spent = used_s - self._used_before_s > self._largest_fraction * (now_s - self._window_began_s)
            self._window_began_s, self._used_before_s = now_s, used_s
        self._urgent = wanted and not self._spent
        if self._urgent is not urgent:
            self._grant(self._urgent)
            self._window_began_s, self._used_before_s = self._now_s(), self._used_s()


def make_urgent(priority: int = HEARTBEAT_PRIORITY, *, inherited: bool = False) -> bool:
    """Give the calling thread real-time priority, or an ordinary one for 0; returns whether the system allows it.

    Threads and processes that it starts are ordinary, unless the priority is `inherited`.
    """
    with contextlib.suppress(OSError, AttributeError):  # not allowed; not Linux
        policy = os.SCHED_RR if priority else os.SCHED_OTHER
        # The flag stays when a thread becomes ordinary: without privileges, the system refuses to remove it.
        flags = 0 if inherited else os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy | flags, os.sched_param(priority))
        return True
    return False


def may_be_urgent() -> bool:
    """Whether this system allows real-time priority."""
    allowed: list[bool] = []
    trying = threading.Thread(target=lambda: allowed.append(make_urgent()))
    trying.start()
    trying.join()
    return allowed == [True]


@asynccontextmanager
async def garbage_frozen() -> AsyncGenerator[None]:
    """Exclude all present objects of this process from garbage collection while the context is open.

    Few of them are garbage, and a full collection holds the interpreter's lock for 0.1 to 0.7 s, which delays
    heartbeats and commands. Full collections of newer objects are short and frequent: Python starts one when new
    objects exceed a quarter of the objects that the last collection kept, which is none here.
    """
    gc.freeze()
    gc.collect()  # keeps nothing; otherwise the next would wait for a quarter of the frozen objects
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def threads_urgent() -> Generator[None]:
    """Make threads urgent that the calling thread starts within the context, and those that they start.

    For the threads of a library, which do not request it themselves. Start no process within the context.
    """
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
    except (OSError, AttributeError):
        before = None
    changed = before is not None and make_urgent(inherited=True)
    try:
        yield
    finally:
        if changed and before is not None:
            with contextlib.suppress(OSError):  # lowering the priority is always allowed
                os.sched_setscheduler(0, *before)


ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Environment variables that keep linear algebra on one thread; they must be set before NumPy is imported.

The matrices here are small: more threads cost time, slow down parallel runs, and make sums depend on their number.
Where other work shares the cores, they wait for one another: eight calibrations of a pair of cameras took 10 s with one
thread and more than 200 s with two, on two cores with a busy process on each.
"""
