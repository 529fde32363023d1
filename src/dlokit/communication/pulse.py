"""Signs of life, given at a steady beat: on the loop in lockstep, from a thread of their own when live."""

import asyncio
import contextlib
import logging
import os
import threading
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Protocol

log = logging.getLogger(__name__)

_TICK_S = 0.05
"""How often the loop shows that it comes round."""
_URGENT_PRIORITY = 5
"""Among real-time threads, which have the machine before all others; low, so that a driver's own come first."""


class Pulse(Protocol):
    """Gives a sign of life again and again while its context is open."""

    def __call__(self, give: Callable[[], None], period_s: float) -> AbstractAsyncContextManager[None]:
        """`give` is called every `period_s`, and must return at once."""
        ...


@asynccontextmanager
async def loop_pulse(give: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
    """On the event loop, in its time: virtual in lockstep."""

    async def beat() -> None:
        while True:
            await asyncio.sleep(period_s)
            give()

    beating = asyncio.create_task(beat(), name="pulse")
    try:
        yield
    finally:
        beating.cancel()


class ThreadPulse:
    """On a thread of its own, on the machine's monotonic clock, for as long as the event loop comes round.

    Work that keeps the loop busy for a moment delays no sign of life; a process that is killed or frozen gives none
    from that moment on; a loop that hangs gives none after `silent_s`.
    """

    def __init__(self, silent_s: float) -> None:
        """`silent_s` is the longest time in which the loop need not come round [s]."""
        self._silent_s = silent_s

    @asynccontextmanager
    async def __call__(self, give: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
        """Beat until the context ends; its last sign has been given when it has ended."""
        came_round_s = time.monotonic()
        over = threading.Event()

        async def come_round() -> None:
            nonlocal came_round_s
            while True:
                came_round_s = time.monotonic()
                await asyncio.sleep(_TICK_S)

        def beat() -> None:
            make_urgent()
            while not over.wait(period_s):
                if time.monotonic() - came_round_s > self._silent_s:
                    continue
                try:
                    give()
                except Exception:  # the next one may get through; if none does, the lease runs out as it should
                    log.exception("a sign of life could not be given")

        rounds = asyncio.create_task(come_round(), name="come round")
        thread = threading.Thread(target=beat, name="pulse", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            rounds.cancel()
            thread.join(period_s)


def make_urgent() -> bool:
    """Let the calling thread have the machine before others, where this is allowed; whether it is."""
    with contextlib.suppress(OSError, AttributeError):  # not allowed; not Linux
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(_URGENT_PRIORITY))
        return True
    return False


def may_be_urgent() -> bool:
    """Whether this system lets a thread have the machine before others."""
    allowed: list[bool] = []
    trying = threading.Thread(target=lambda: allowed.append(make_urgent()))
    trying.start()
    trying.join()
    return allowed == [True]
