"""When a search must end: by the machine's time where it is live, never where runs are to repeat."""

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")

_BATCH_A_CORE = 8  # rollouts between two looks at the time


class Timer:
    """A time for a whole decision, of which parts are allowed one after the other. Without stopwatch it never ends."""

    def __init__(self, seconds: float, stopwatch: Callable[[], float] | None) -> None:
        self._seconds, self._stopwatch = seconds, stopwatch
        self._began = stopwatch() if stopwatch is not None else 0.0
        self._played = 0
        self._until_s = seconds

    def count(self, rollouts: int) -> None:
        """So many rollouts were played."""
        self._played += rollouts

    def allow(self, share: float, reserved: int) -> None:
        """From now on, up to that share of the time, less what `reserved` rollouts will take at the pace so far."""
        self._until_s = share * max(0.0, self._seconds - reserved * self._each_s())

    def batches(self, items: Sequence[T]) -> Iterator[Sequence[T]]:
        """The items in batches, until the allowed time is over; in one batch where there is no time."""
        size = len(items) if self._stopwatch is None else _BATCH_A_CORE * len(os.sched_getaffinity(0))
        for start in range(0, len(items), max(1, size)):
            # Something must be played, or there is nothing to do.
            if self._stopwatch is not None and self._played > 0 and self._passed_s() >= self._until_s:
                return
            yield items[start : start + size]

    def affordable(self, count: int, each: int) -> int:
        """How many of `count` things that take `each` rollouts fit into the time that is left; at least one."""
        if self._stopwatch is None or each == 0:
            return count
        left_s = self._seconds - self._passed_s()
        return min(count, max(1, int(left_s / max(each * self._each_s(), 1e-9))))

    def _passed_s(self) -> float:
        return 0.0 if self._stopwatch is None else self._stopwatch() - self._began

    def _each_s(self) -> float:
        """What a rollout has taken so far [s]."""
        return self._passed_s() / self._played if self._played else 0.0
