"""Conversion of a camera's clock to the host's monotonic clock, with an offset and its uncertainty.

A picture arrives after its exposure: later by what every picture needs (readout, transfer), and by a delay that differs
from picture to picture. The smallest difference of arrival and stamp within a window has next to none of the second.
"""

from collections import deque
from dataclasses import dataclass

_WINDOW = 300
"""Pictures of the window: 10 s at 30 Hz, in which two quartz clocks drift apart by less than a millisecond."""
_JUMP_NS = 1_000_000_000
"""A stamp that jumps against its arrival by more than this is of another clock: the device was started again [ns]."""


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """What is known of the offset of two clocks."""

    offset_ns: int
    """Host's time minus device's time [ns]."""
    uncertainty_ns: int
    """By how much the offset may be wrong [ns]."""


class DeviceClock:
    """Learns the offset of a device's clock from its pictures."""

    def __init__(self, least_latency_ns: int) -> None:
        """`least_latency_ns` is what every picture needs from its exposure to its arrival [ns]."""
        self._least_latency_ns = least_latency_ns
        self._differences = deque[int](maxlen=_WINDOW)

    def arrived(self, device_ns: int, host_ns: int) -> ClockOffset:
        """The offset with the picture of the device's time `device_ns` that arrived at the host's time `host_ns`."""
        difference_ns = host_ns - device_ns
        if self._differences and abs(difference_ns - self._differences[-1]) > _JUMP_NS:
            self._differences.clear()
        self._differences.append(difference_ns)
        ordered = sorted(self._differences)
        # What all have in common is known to a half; a window of few pictures may lack one without a delay.
        spread_ns = (ordered[len(ordered) // 2] - ordered[0]) // len(ordered)
        return ClockOffset(
            offset_ns=ordered[0] - self._least_latency_ns,
            uncertainty_ns=self._least_latency_ns // 2 + spread_ns,
        )
