"""Clocks that components wait on: integer nanoseconds, never wall-clock time."""

import asyncio
import heapq
import itertools
import time
from collections.abc import AsyncGenerator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Protocol


def suspended_too_ns() -> int:
    """The machine's time since its start [ns], including suspensions if the system counts them.

    Leases and the age of an arm's feedback use it: a motion must not continue after a suspension. Deadlines
    of calls and heartbeats of processes use the monotonic clock, which stops during a suspension, as processes do.
    """
    if hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return time.monotonic_ns()


class Clock(Protocol):
    """The clock of the cell or of the hardware."""

    def now_ns(self) -> int:
        """Time now [ns]."""
        ...

    async def sleep_until(self, stamp_ns: int) -> None:
        """Wait until the clock shows `stamp_ns`."""
        ...

    async def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` on this clock."""
        ...

    def timeout(self, duration_s: float, /) -> AbstractAsyncContextManager[asyncio.Timeout]:
        """Like `asyncio.timeout`, on this clock: it cancels its body and raises `TimeoutError`."""
        ...


class LoopClock:
    """The time of the running event loop: virtual in lockstep, the machine's monotonic clock on hardware."""

    def now_ns(self) -> int:
        """Time now [ns]."""
        return round(asyncio.get_running_loop().time() * 1e9)

    async def sleep_until(self, stamp_ns: int) -> None:
        """Wait until the clock shows `stamp_ns`; yields once even if that time has passed."""
        await asyncio.sleep(max(0.0, stamp_ns / 1e9 - asyncio.get_running_loop().time()))

    async def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s`."""
        await asyncio.sleep(duration_s)

    timeout = staticmethod(asyncio.timeout)
    """A time limit in seconds."""


class FollowedClock:
    """The clock of another process, followed by its ticks: it may be slower than the machine's, or not advance.

    Before the first tick its time is unknown, and may be days: durations that begin earlier count from the first tick.
    """

    def __init__(self) -> None:
        self._now_ns = 0
        self._before_first: list[tuple[int, asyncio.Future[None]]] = []
        self._waiting: list[tuple[int, int, asyncio.Future[None]]] = []
        self._order = itertools.count()

    def tick(self, stamp_ns: int) -> None:
        """Set the time to `stamp_ns` and wake the tasks that are due; a smaller stamp is ignored."""
        self._now_ns = max(self._now_ns, stamp_ns)
        if self._now_ns > 0:
            for duration_ns, future in self._before_first:
                heapq.heappush(self._waiting, (self._now_ns + duration_ns, next(self._order), future))
            self._before_first = []
        while self._waiting and self._waiting[0][0] <= self._now_ns:
            future = heapq.heappop(self._waiting)[2]
            if not future.done():
                future.set_result(None)

    def now_ns(self) -> int:
        """Stamp of the last tick [ns]."""
        return self._now_ns

    async def sleep_until(self, stamp_ns: int) -> None:
        """Wait for the first tick at or after `stamp_ns`; watchdogs detect a clock that does not advance."""
        if stamp_ns <= self._now_ns:
            await asyncio.sleep(0)
            return
        await self._wake_at(stamp_ns)

    async def sleep(self, duration_s: float) -> None:
        """Wait for `duration_s` of this clock."""
        duration_ns = round(duration_s * 1e9)
        if duration_ns <= 0:
            await asyncio.sleep(0)
            return
        await self._wake_after(duration_ns)

    @asynccontextmanager
    async def timeout(self, duration_s: float) -> AsyncGenerator[asyncio.Timeout]:
        """A time limit of `duration_s` on this clock; it never expires while the clock does not advance."""
        async with asyncio.timeout(None) as limit:
            due = self._wake_after(round(duration_s * 1e9))
            over = False

            def expire(woken: asyncio.Future[None]) -> None:
                if not over and not woken.cancelled():
                    limit.reschedule(0.0)

            due.add_done_callback(expire)
            try:
                yield limit
            finally:
                over = True
                due.cancel()

    def _wake_after(self, duration_ns: int) -> asyncio.Future[None]:
        if self._now_ns > 0:
            return self._wake_at(self._now_ns + duration_ns)
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._before_first.append((duration_ns, future))
        return future

    def _wake_at(self, stamp_ns: int) -> asyncio.Future[None]:
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._waiting, (stamp_ns, next(self._order), future))
        return future
