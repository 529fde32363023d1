"""What a commander asks of the arm, and what becomes of it: reported to the process that has started the commander."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from dlokit.types.outcome import Failed, Outcome, Rejected


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One call of a skill."""

    skill: str
    """Its key, e.g. ``robot.grasp``."""
    began_s: float
    """By the machine's monotonic clock [s]."""
    ended_s: float | None = None
    """By the same clock [s]; None: it still runs."""
    ended_as: str = ""
    """The kind of its outcome and the reason, e.g. ``Rejected stop_latched``."""


def outcome_name(outcome: Outcome[Any]) -> str:
    """The kind of an outcome, and its reason where it has one."""
    match outcome:
        case Failed(reason=reason) | Rejected(reason=reason):
            return f"{type(outcome).__name__} {reason}"
        case _:
            return type(outcome).__name__


class AttemptLog:
    """The attempts of the commander that runs now. Made and used on a running event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._reports: Connection | None = None
        self._ended: list[Attempt] = []
        self._running: Attempt | None = None
        self._changed = asyncio.Event()

    @property
    def running(self) -> str:
        """Key of the skill that runs; empty when none does, as far as was reported."""
        return self._running.skill if self._running is not None else ""

    def listen(self, reports: Connection) -> None:
        """Read the reports of a new commander, in the place of those of the previous one."""
        self.close()
        self._reports = reports
        self._loop.add_reader(reports.fileno(), self._read, reports)

    def close(self) -> None:
        """Read no more."""
        if self._reports is not None:
            self._loop.remove_reader(self._reports.fileno())
            self._reports.close()
        self._reports, self._running = None, None

    def between(self, begin_s: float, end_s: float) -> list[Attempt]:
        """Attempts that began and ended between two times of the machine's monotonic clock [s]."""
        return [
            attempt
            for attempt in self._ended
            if attempt.began_s >= begin_s and attempt.ended_s is not None and attempt.ended_s <= end_s
        ]

    async def until(self, is_so: Callable[[], bool], within_s: float) -> bool:
        """Wait until `is_so` holds, which is looked at after each report; whether it did within `within_s` [s]."""
        try:
            async with asyncio.timeout(within_s):
                while not is_so():
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True

    def _read(self, reports: Connection) -> None:
        try:
            while reports.poll():
                self._note(reports.recv())
        except (EOFError, OSError):  # the commander was killed
            self.close()
        self._changed.set()

    def _note(self, attempt: Attempt) -> None:
        if attempt.ended_s is None:
            self._running = attempt
        else:
            self._running = None
            self._ended.append(attempt)
