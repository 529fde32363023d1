import numpy as np

from dlokit.functional.cameras.device_clock import DeviceClock

LATENCY_NS = 10_000_000
PERIOD_NS = 33_333_333
START_NS = 5_000_000_000_000


def test_the_offset_is_that_of_the_fastest_picture_and_the_uncertainty_covers_the_error():
    rng = np.random.default_rng(0)
    clock = DeviceClock(LATENCY_NS)
    errors: list[int] = []
    offset = clock.arrived(0, START_NS + 12_000_000)
    for number in range(1, 300):
        device_ns = number * PERIOD_NS
        delay_ns = 12_000_000 + int(rng.exponential(4e6))
        offset = clock.arrived(device_ns, START_NS + device_ns + delay_ns)
        errors.append(abs(offset.offset_ns - START_NS))
        assert errors[-1] <= offset.uncertainty_ns + 2_000_000  # latency beyond the least one
    assert errors[-1] < 2_500_000
    assert offset.uncertainty_ns < 6_000_000


def test_a_drift_of_the_device_is_followed():
    clock = DeviceClock(LATENCY_NS)
    offset = clock.arrived(0, START_NS + LATENCY_NS)
    for number in range(1, 3000):  # 100 s, 50 ppm
        device_ns = number * PERIOD_NS
        offset = clock.arrived(device_ns, START_NS + round(device_ns * (1 + 50e-6)) + LATENCY_NS)
    drifted_ns = round(2999 * PERIOD_NS * 50e-6)
    assert abs(offset.offset_ns - START_NS - drifted_ns) < 600_000  # what it drifts in a window


def test_a_device_that_starts_again_has_another_offset():
    clock = DeviceClock(LATENCY_NS)
    clock.arrived(9_000_000_000, START_NS)
    offset = clock.arrived(0, START_NS + PERIOD_NS)
    assert offset.offset_ns == START_NS + PERIOD_NS - LATENCY_NS
