"""A clock that a test advances: waits on it take no time."""


class HandClock:
    """Time [ns] that passes only by `advance`; what is given to code that asks for the time is the object itself."""

    def __init__(self) -> None:
        self._now_ns = 50_000_000_000

    def __call__(self) -> int:
        return self._now_ns

    def advance(self, duration_s: float) -> None:
        self._now_ns += round(duration_s * 1e9)
