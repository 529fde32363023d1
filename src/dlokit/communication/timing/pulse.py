"""Periodic heartbeats: sent by the event loop in lockstep, by a separate thread when live."""

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
"""An event loop that takes longer than this for one turn [s] counts as hanging."""
_TICK_S = 0.05
"""Period at which the event loop marks that it runs [s]."""


class Pulse(Protocol):
    """Sends a heartbeat periodically while its context is open."""

    def __call__(self, send: Callable[[], None], period_s: float, /) -> AbstractAsyncContextManager[None]:
        """`send` is called every `period_s`, and must return at once."""
        ...


@asynccontextmanager
async def loop_pulse(send: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
    """Send heartbeats from the event loop, in its time: virtual in lockstep."""

    async def beat() -> None:
        while True:
            await asyncio.sleep(period_s)
            send()

    beating = asyncio.create_task(beat(), name="pulse")
    try:
        yield
    finally:
        beating.cancel()


class ThreadPulse:
    """Sends heartbeats from its own thread, on the machine's monotonic clock, while the event loop runs.

    A short computation on the loop delays no heartbeat. A killed or frozen process sends none from that moment on; a
    loop that hangs sends none after `silent_s`.
    """

    def __init__(self, silent_s: float = LOOP_SILENT_S, now_s: Callable[[], float] = time.monotonic) -> None:
        """`silent_s` is the longest time that the loop may take for one turn [s], by the clock `now_s`."""
        self._silent_s = silent_s
        self._now_s = now_s

    @asynccontextmanager
    async def __call__(self, send: Callable[[], None], period_s: float) -> AsyncGenerator[None]:
        """Send heartbeats until the context ends; none is sent afterwards."""
        last_turn_s = self._now_s()
        over = threading.Event()
        urgency = BoundedUrgency()

        async def mark_turns() -> None:
            nonlocal last_turn_s
            while True:
                last_turn_s = self._now_s()
                # A loop thread that is preempted while it holds the interpreter's lock would delay the heartbeats.
                urgency(True)
                await asyncio.sleep(_TICK_S)

        def beat() -> None:
            make_urgent()
            while not over.wait(period_s):
                if self._now_s() - last_turn_s > self._silent_s:
                    continue
                try:
                    send()
                except Exception:  # the next one may succeed; if none does, the lease expires as it should
                    log.exception("a heartbeat could not be sent")

        turns = asyncio.create_task(mark_turns(), name="loop turns")
        thread = threading.Thread(target=beat, name="pulse", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            turns.cancel()
            urgency(False)
            thread.join(period_s)
