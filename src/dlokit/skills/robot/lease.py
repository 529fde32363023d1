"""Who may move the robot, and until when. Pure: the machine's monotonic clock is handed in."""

from collections.abc import Callable

from dlokit.errors import SkillRejected


class LeaseKeeper:
    """The one lease on a robot."""

    def __init__(self, monotonic_ns: Callable[[], int]) -> None:
        self._monotonic_ns = monotonic_ns
        self._holder = ""
        self._ends_ns = 0

    @property
    def taken(self) -> bool:
        """Whether somebody has taken the lease and not given it back, in time or not."""
        return self._holder != ""

    @property
    def lost(self) -> bool:
        """Whether the lease was taken and has run out."""
        return self.taken and self._monotonic_ns() >= self._ends_ns

    @property
    def holder(self) -> str:
        """Who has it; empty when nobody."""
        return self._holder

    def renew(self, holder: str, duration_s: float) -> None:
        """Take or keep the lease. Raises `SkillRejected` ``leased`` while another holds it."""
        self._refuse_others(holder)
        self._holder = holder
        self._ends_ns = self._monotonic_ns() + round(duration_s * 1e9)

    def release(self, holder: str) -> None:
        """Give the lease back. Raises `SkillRejected` ``leased`` while another holds it."""
        self._refuse_others(holder)
        self._holder = ""

    def _refuse_others(self, holder: str) -> None:
        if self.taken and holder != self._holder and not self.lost:
            raise SkillRejected(
                "leased", f"{self._holder} moves this robot; {holder} may take it once {self._holder} gives it back"
            )
