"""Watching a recorded run: its timeline, and the player that moves along it. Pure: no page, no file, no clock."""

import enum
from dataclasses import dataclass, field
from itertools import pairwise


class MarkKind(enum.Enum):
    """Kinds of moments in a run."""

    STEP = "step"
    ACTION = "action"
    END = "end"


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A moment of a recorded run."""

    time_s: float
    """Time since the recording began [s]."""
    kind: MarkKind
    name: str
    """The beginning step, action or end: ``plan``, ``task 1, action 1``, ``task 1: converged``."""


@dataclass(frozen=True, kw_only=True)
class RunTimeline:
    """Name, duration and moments of a recorded run."""

    name: str
    recorded_at: str
    """When the recording ended, as text, e.g. ``"ended 2026-01-01 12:00"``."""
    begin_ns: int
    """Beginning of the recording on the run's clock [ns]."""
    duration_s: float
    marks: tuple[Mark, ...] = ()
    """In order of time."""
    waits: tuple[tuple[float, float], ...] = ()
    """Beginning and end [s] of the parts to skip, in which no arm moves."""

    def of(self, kind: MarkKind) -> tuple[Mark, ...]:
        """The marks of one kind."""
        return tuple(mark for mark in self.marks if mark.kind is kind)

    def steps(self) -> tuple[tuple[float, float, str], ...]:
        """Beginning, end [s] and name of each step."""
        marks = self.of(MarkKind.STEP)
        ends = [mark.time_s for mark in marks[1:]] + [self.duration_s]
        return tuple((mark.time_s, end_s, mark.name) for mark, end_s in zip(marks, ends, strict=False))


SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Seconds of the run per second, to choose from."""
_SAME_S = 0.05
"""Moments that differ by less than this count as the same [s]."""
_JUST_BEGUN_S = 0.5
"""“Previous” skips an action that began less than this time ago [s], so that two presses move two actions."""


@dataclass(kw_only=True)
class Player:
    """The shown moment of a recorded run, and how it advances."""

    timeline: RunTimeline
    speed: float = 1.0
    """Seconds of the run per second."""
    skips_waits: bool = True
    position_s: float = 0.0
    """Time since the recording began [s]."""
    playing: bool = False
    jumped: bool = field(default=True, init=False)
    """Whether the position has changed other than by playing; the consumer resets it once it has shown the position."""

    @property
    def ended(self) -> bool:
        """Whether the position is the end."""
        return self.position_s >= self.timeline.duration_s - _SAME_S

    def play(self) -> None:
        """Play on; at the end, from the beginning."""
        if self.ended:
            self.seek(0.0)
        self.playing = True

    def pause(self) -> None:
        """Stay at the position."""
        self.playing = False

    def seek(self, time_s: float) -> None:
        """Go to a time [s]; playing or paused as before."""
        self.position_s = min(max(time_s, 0.0), self.timeline.duration_s)
        self.jumped = True

    def next_action(self) -> None:
        """Go to the beginning of the next action, or to the next end of a task."""
        later = [mark.time_s for mark in self._stops() if mark.time_s > self.position_s + _SAME_S]
        self.seek(later[0] if later else self.timeline.duration_s)

    def previous_action(self) -> None:
        """Go to the beginning of the previous action, or to the beginning of the run."""
        earlier = [mark.time_s for mark in self._stops() if mark.time_s < self.position_s - _JUST_BEGUN_S]
        self.seek(earlier[-1] if earlier else 0.0)

    def _stops(self) -> tuple[Mark, ...]:
        return tuple(mark for mark in self.timeline.marks if mark.kind is not MarkKind.STEP)

    def advance(self, elapsed_s: float) -> None:
        """Advance by `elapsed_s` seconds of playing; pause at the end."""
        if not self.playing:
            return
        position_s = self.position_s + elapsed_s * self.speed
        for begin_s, end_s in self.timeline.waits if self.skips_waits else ():
            if begin_s <= position_s < end_s:
                position_s = end_s
        self.position_s = min(position_s, self.timeline.duration_s)
        if self.ended:
            self.position_s, self.playing = self.timeline.duration_s, False


def waits_between(
    moving_s: list[float], duration_s: float, *, before_s: float, after_s: float
) -> tuple[tuple[float, float], ...]:
    """The parts to skip (beginning, end) [s] of a run whose arms move at the times `moving_s`, in order.

    The first `after_s` and the last `before_s` seconds of each wait are kept, so that people see its cause and its end.
    """
    edges = [0.0, *moving_s, duration_s]
    skipped = ((begin + after_s, end - before_s) for begin, end in pairwise(edges))
    return tuple((begin, end) for begin, end in skipped if end > begin)
