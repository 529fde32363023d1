"""The clock of the cell's camera: another one than the cell's, and pictures that arrive after their exposure.

A real driver converts its device's stamps by when the pictures arrive; so does this. What it cannot know is how long
every picture takes at least: by so much its stamps are late, until `dlokit calibrate latency` has measured it.
"""

from dlokit.functional.cameras.device_clock import DeviceClock

_SWITCHED_ON_NS = 7_000_000_000
"""The device's clock at the beginning of the cell's time: it is older [ns]."""


class CameraClock:
    """Stamps pictures by a clock that drifts and may jump, converted to the cell's time by the pictures' arrival."""

    def __init__(self, drift_ppm: float) -> None:
        """`drift_ppm`: by how many microseconds a second the device's clock is fast."""
        self._drift = 1e-6 * drift_ppm
        self._ahead_ns = _SWITCHED_ON_NS
        self._clock = DeviceClock(least_latency_ns=0)

    def stamped(self, exposed_ns: int, arrived_ns: int) -> int:
        """The stamp of a picture [ns] that was exposed and that arrived at these times of the cell.

        Raises `ClockJumped` at the first picture after a jump.
        """
        device_ns = exposed_ns + round(exposed_ns * self._drift) + self._ahead_ns
        return device_ns + self._clock.arrived(device_ns, arrived_ns).offset_ns

    def jump(self, by_ns: int) -> None:
        """Set the device's clock forward [ns]. For tests and benches: no skill does it."""
        self._ahead_ns += by_ns
