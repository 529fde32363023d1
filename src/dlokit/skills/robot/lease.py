"""Who may move the robot, and until when. Pure: the machine's monotonic clock is handed in."""

import math
import threading
from collections.abc import Callable

from dlokit.errors import SkillRejected
from dlokit.types.robot import RobotReason


class LeaseKeeper:
    """The one lease on a robot. Any thread may ask and renew."""

    def __init__(self, monotonic_ns: Callable[[], int]) -> None:
        self._monotonic_ns = monotonic_ns
        self._lock = threading.Lock()
        self._holder = ""
        self._duration_ns = 0
        self._ends_ns = 0

    @property
    def taken(self) -> bool:
        """Whether somebody has taken the lease and not given it back, in time or not."""
        return self._holder != ""

    @property
    def lost(self) -> bool:
        """Whether the lease was taken and has run out."""
        return self.left_s <= 0.0

    @property
    def left_s(self) -> float:
        """Time until it runs out [s]; inf while nobody has it."""
        with self._lock:
            return (self._ends_ns - self._monotonic_ns()) / 1e9 if self._holder else math.inf

    @property
    def holder(self) -> str:
        """Who has it; empty when nobody."""
        return self._holder

    def allows(self, holder: str) -> bool:
        """Whether a motion of that holder may begin: it has the lease and it runs, or nobody has it."""
        return not self.lost and self._holder in ("", holder)

    def renew(self, holder: str, duration_s: float) -> None:
        """Take or keep the lease. Raises `SkillRejected` ``leased`` while another holds it."""
        with self._lock:
            self._refuse_others(holder)
            self._holder = holder
            self._duration_ns = round(duration_s * 1e9)
            self._ends_ns = self._monotonic_ns() + self._duration_ns

    def hear(self, holder: str) -> None:
        """A sign of life keeps the lease for its duration from now on; one of anybody but its holder does nothing."""
        with self._lock:
            if holder and holder == self._holder:
                self._ends_ns = self._monotonic_ns() + self._duration_ns

    def release(self, holder: str) -> None:
        """Give the lease back. Raises `SkillRejected` ``leased`` while another holds it."""
        with self._lock:
            self._refuse_others(holder)
            self._holder = ""

    def _refuse_others(self, holder: str) -> None:
        if self._holder not in ("", holder) and self._monotonic_ns() < self._ends_ns:
            raise SkillRejected(
                RobotReason.LEASED,
                f"{self._holder} moves this robot; {holder} may take it once {self._holder} gives it back",
            )
