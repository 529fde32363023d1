"""When the cell's next tick is due on its host's clock."""

from dlokit.functional.cell.config import TICK_S

_SLIP_NS = 100_000_000  # the cell falls that far behind before it gives up catching up
_MEMORY = 0.98  # of the running mean of the pace, a tick


class Pace:
    """Ticks at real time or slower: a cell that cannot keep up falls back instead of racing afterwards."""

    def __init__(self, real_time_factor: float, now_ns: int) -> None:
        self._period_ns = round(TICK_S * 1e9 / real_time_factor)
        self._due_ns = now_ns
        self._last_ns = now_ns
        self._mean_ns = float(self._period_ns)

    @property
    def real_time_factor(self) -> float:
        """Cell seconds a second of the host's clock, lately."""
        return TICK_S * 1e9 / self._mean_ns

    def next_ns(self, now_ns: int) -> int:
        """When the next tick is due; call once a tick."""
        self._mean_ns = _MEMORY * self._mean_ns + (1.0 - _MEMORY) * (now_ns - self._last_ns)
        self._last_ns = now_ns
        self._due_ns = max(self._due_ns + self._period_ns, now_ns - _SLIP_NS)
        return self._due_ns
