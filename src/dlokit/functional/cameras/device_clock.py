"""Conversion of a camera's clock to the host's monotonic clock, with an offset and its uncertainty.

A picture arrives after its exposure: later by a constant latency (readout, transfer), and by a delay that varies from
picture to picture. The smallest difference of arrival and stamp has almost no variable delay. Two clocks drift apart,
so an older difference is less certain: it is enlarged by the most that the clocks may have drifted since.
"""

from collections import deque
from dataclasses import dataclass

from dlokit.errors import ClockJumped
from dlokit.functional.cameras.base import JUMP_NS

_WINDOW = 300
"""Number of pictures that are compared: 10 s at 30 Hz, so that at least one arrives without a variable delay."""
_DRIFT = 100e-6
"""Largest drift of two clocks against each other: quartz oscillators are within 50 ppm each."""


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """The estimated offset of two clocks."""

    offset_ns: int
    """Host's time minus device's time [ns]."""
    uncertainty_ns: int
    """Largest error of the offset [ns]."""


class DeviceClock:
    """Learns the offset of a device's clock from its pictures."""

    def __init__(self, least_latency_ns: int) -> None:
        """`least_latency_ns` is the smallest time from a picture's exposure to its arrival [ns]."""
        self._least_latency_ns = least_latency_ns
        self._pictures = deque[tuple[int, int]](maxlen=_WINDOW)  # arrival, arrival minus stamp [ns]

    def arrived(self, device_ns: int, host_ns: int) -> ClockOffset:
        """Update the offset with a picture that has the device's stamp `device_ns` and arrived at the host's `host_ns`.

        Raises `ClockJumped` when the stamp contradicts earlier ones; the offset is then learned again from this stamp.
        """
        difference_ns = host_ns - device_ns
        known = self._by_age(host_ns)
        jump_ns = difference_ns - min(known, default=difference_ns)
        if abs(jump_ns) >= JUMP_NS:
            self._pictures.clear()
        self._pictures.append((host_ns, difference_ns))
        if abs(jump_ns) >= JUMP_NS:
            raise ClockJumped(
                f"the stamps of the camera jumped by {-jump_ns / 1e9:+.3f} s against the host's clock: the device was "
                "started again, or its clock was set; the offset is learned again from its next pictures. "
                "If it happens again and again, keep NTP or PTP from setting the camera's clock"
            )
        ordered = sorted(self._by_age(host_ns))
        # The constant latency is known to a half; a window of few pictures may lack one without a delay.
        spread_ns = (ordered[len(ordered) // 2] - ordered[0]) // len(ordered)
        return ClockOffset(
            offset_ns=ordered[0] - self._least_latency_ns,
            uncertainty_ns=self._least_latency_ns // 2 + spread_ns,
        )

    def _by_age(self, now_ns: int) -> list[int]:
        """The differences of the pictures [ns], each enlarged by the drift that is possible since."""
        return [difference_ns + round(_DRIFT * (now_ns - then_ns)) for then_ns, difference_ns in self._pictures]
