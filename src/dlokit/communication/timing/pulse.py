"""Signs of life, given at a steady beat: on the loop in lockstep, from a thread of their own when live."""

import asyncio
import logging
import threading
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Protocol

from dlokit.communication.timing.urgency import BoundedUrgency, make_urgent

log = logging.getLogger(__name__)

LOOP_SILENT_S = 1.0
"""An event loop that has not come round for this long [s] is taken to hang."""
_TICK_S = 0.05
"""How often the loop shows that it comes round."""


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

    def __init__(self, silent_s: float = LOOP_SILENT_S) -> None:
        """`silent_s` is the longest time in which the loop need not come round [s]."""
        self._silent_s = silent_s

    @asynccontextmanager
    async def __call__(self, give: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
        """Beat until the context ends; its last sign has been given when it has ended."""
        came_round_s = time.monotonic()
        over = threading.Event()
        urgency = BoundedUrgency()

        async def come_round() -> None:
            nonlocal came_round_s
            while True:
                came_round_s = time.monotonic()
                # A loop that is put aside while it holds the interpreter's lock keeps the signs of life waiting.
                urgency(True)
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
            urgency(False)
            thread.join(period_s)
