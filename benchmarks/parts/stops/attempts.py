"""What the commander of an arm attempts, as it reports from its own process."""

import asyncio
from dataclasses import dataclass
from multiprocessing.connection import Connection

from parts.logs import Changing


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


class AttemptLog(Changing):
    """The attempts of the commander that runs now."""

    def __init__(self) -> None:
        super().__init__()
        self._reports: Connection | None = None
        self._ended: list[Attempt] = []
        self.running = ""
        """Key of the skill that runs; empty when none does, as far as was reported."""

    def listen(self, reports: Connection) -> None:
        """Read the reports of a new commander, in the place of those of the previous one."""
        self.close()
        self._reports = reports
        asyncio.get_running_loop().add_reader(reports.fileno(), self._read, reports)

    def close(self) -> None:
        """Read no more."""
        if self._reports is not None:
            asyncio.get_running_loop().remove_reader(self._reports.fileno())
            self._reports.close()
        self._reports, self.running = None, ""

    def between(self, begin_s: float, end_s: float) -> list[Attempt]:
        """Attempts that began and ended between two times of the machine's monotonic clock [s]."""
        return [one for one in self._ended if begin_s <= one.began_s and (one.ended_s or 0.0) <= end_s]

    def _read(self, reports: Connection) -> None:
        try:
            while reports.poll():
                attempt: Attempt = reports.recv()
                self.running = attempt.skill if attempt.ended_s is None else ""
                if attempt.ended_s is not None:
                    self._ended.append(attempt)
        except (EOFError, OSError):  # the commander was killed
            self.close()
        self.note_change()
