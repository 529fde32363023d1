"""When a search must end: by the machine's time where it is live, never where runs are to repeat."""

import math
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")

_LARGEST_BATCH = 8  # rollouts a core between two looks at the time
_BATCH_SHARE = 0.05  # of the time, that a batch may take
_FINALS_SHARE = 0.3  # of the time, that is kept for the finals at most
_PATIENCE = 3.0  # times the time, that a decision on a busy machine may take at most


class Timer:
    """A time for a whole decision, of which parts are allowed one after the other. Without stopwatch it never ends.

    On a machine so busy that fewer than the `least` rollouts would fit, the time is as much longer, up to three times:
    an action chosen among a dozen costs the robot more than the wait.
    """

    def __init__(
        self, seconds: float, stopwatch: Callable[[], float] | None, cores: int = 0, *, least: int = 0
    ) -> None:
        """`cores` that play at once; 0: those of this machine."""
        self._asked_s, self._least, self._stopwatch = seconds, least, stopwatch
        self._cores = cores or len(os.sched_getaffinity(0))
        self._began_s = stopwatch() if stopwatch is not None else 0.0
        self._played, self._playing_s = 0, 0.0
        self._until = 1.0  # share of the time
        self._kept_s = 0.0

    @contextmanager
    def playing(self, rollouts: int) -> Generator[None]:
        """So many rollouts are played in the block."""
        began_s = self._passed_s()
        yield
        self._played += rollouts
        self._playing_s += self._passed_s() - began_s

    def allow(self, share: float, finalists: int, each: int) -> None:
        """From now on, up to that share of the time, less what finalists of `each` rollouts will take at this pace.

        Where not even a part of the finals would end in its share of the time, none is kept for them.
        """
        part_s, most_s = each * self._cores * self._each_s(), _FINALS_SHARE * self._seconds
        kept_s = min(math.ceil(finalists / self._cores) * part_s, most_s) if part_s <= most_s else 0.0
        self._until, self._kept_s = share, kept_s

    def too_short_for(self, rollouts: int) -> bool:
        """Whether at this pace so many rollouts would take longer than the time asked for."""
        return self._stopwatch is not None and rollouts * self._each_s() > self._asked_s

    @property
    def over(self) -> bool:
        """Whether the allowed time has passed. Something must be played, or there is nothing to do."""
        return (
            self._stopwatch is not None
            and self._played > 0
            and self._passed_s() >= self._until * (self._seconds - self._kept_s)
        )

    def batch(self, count: int) -> int:
        """How many of `count` rollouts to play before the next look at the time: a few while the pace is not known."""
        if self._stopwatch is None:
            return count
        if self._played == 0:
            return min(count, self._cores)
        rounds = int(_BATCH_SHARE * self._seconds / max(self._cores * self._each_s(), 1e-9))
        return min(count, self._cores * min(max(rounds, 1), _LARGEST_BATCH))

    def rounds(self, items: Sequence[T], each: int) -> Iterator[Sequence[T]]:
        """The items, which take `each` rollouts, in parts that will end in the whole time, at the pace so far."""
        size = len(items) if self._stopwatch is None else self._cores
        for start in range(0, len(items), max(1, size)):
            ends_s = self._passed_s() + each * self._cores * self._each_s()
            if self._stopwatch is not None and ends_s > self._seconds:
                return
            yield items[start : start + size]

    @property
    def _seconds(self) -> float:
        """The time for the decision, at the pace so far [s]."""
        if self._played == 0:
            return self._asked_s
        needed_s = self._least * self._passed_s() / self._played
        return min(max(self._asked_s, needed_s), _PATIENCE * self._asked_s)

    def _passed_s(self) -> float:
        return 0.0 if self._stopwatch is None else self._stopwatch() - self._began_s

    def _each_s(self) -> float:
        """What a rollout has taken so far, many at once [s]."""
        return self._playing_s / self._played if self._played else 0.0
