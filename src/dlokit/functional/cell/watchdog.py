"""The lease of a motion: without signs of life from its commander, the arm brakes."""


class Watchdog:
    """Measures silence on the machine's clock, so that a slow cell does not look like a lost commander.

    Time in which the cell itself was busy, rendering say, and could not listen does not count: of the time between
    two looks, at most `longest_tick_s` does.
    """

    def __init__(self, longest_tick_s: float) -> None:
        self._longest_tick_s = longest_tick_s
        self._lease_s: float | None = None
        self._silence_s = 0.0
        self._looked_s: float | None = None

    def arm(self, lease_s: float) -> None:
        """Begin to listen."""
        self._lease_s, self._silence_s, self._looked_s = lease_s, 0.0, None

    def disarm(self) -> None:
        """End listening."""
        self._lease_s = None

    def renew(self) -> None:
        """The commander is there."""
        self._silence_s = 0.0

    def expired(self, now_s: float) -> bool:
        """Whether the silence has lasted longer than the lease; `now_s` is the machine's monotonic clock."""
        if self._lease_s is None:
            return False
        if self._looked_s is not None:
            self._silence_s += min(now_s - self._looked_s, self._longest_tick_s)
        self._looked_s = now_s
        return self._silence_s > self._lease_s
