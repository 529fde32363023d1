import numpy as np
import pytest

from dlokit.errors import ClockJumped
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


@pytest.mark.parametrize("drift", [50e-6, -50e-6])
@pytest.mark.parametrize("period_s", [1 / 30, 2.0])  # a stream, and looks on demand
def test_a_drift_of_the_device_is_followed(drift: float, period_s: float):
    clock = DeviceClock(LATENCY_NS)
    offset = clock.arrived(0, START_NS + LATENCY_NS)
    number, period_ns = 3000, round(period_s * 1e9)
    for index in range(1, number):
        device_ns = index * period_ns
        offset = clock.arrived(device_ns, START_NS + round(device_ns * (1 + drift)) + LATENCY_NS)
    drifted_ns = round((number - 1) * period_ns * drift)
    assert abs(offset.offset_ns - START_NS - drifted_ns) < 200_000  # less than the clocks drift in 2 s


@pytest.mark.parametrize("jump_s", [1.0, -1.0, 0.5, 3600.0])
@pytest.mark.parametrize("gap_s", [0.033, 5.0])
def test_a_jump_of_the_clock_is_named_once_and_the_offset_is_learned_again(jump_s: float, gap_s: float):
    clock = DeviceClock(LATENCY_NS)
    jump_ns, gap_ns = round(jump_s * 1e9), round(gap_s * 1e9)
    for number in range(50):
        clock.arrived(number * PERIOD_NS, START_NS + number * PERIOD_NS + LATENCY_NS)
    then_ns = 49 * PERIOD_NS + gap_ns
    # The fastest picture after the jump: the drift that is allowed for must not hide it.
    with pytest.raises(ClockJumped, match=f"jumped by .{abs(jump_s):.2f}"):
        clock.arrived(then_ns + jump_ns + (1_000_000 if jump_s > 0 else -1_000_000), START_NS + then_ns + LATENCY_NS)
    after = clock.arrived(then_ns + jump_ns + PERIOD_NS, START_NS + then_ns + PERIOD_NS + LATENCY_NS)
    assert abs(after.offset_ns + jump_ns - START_NS) <= 1_000_000


def test_a_picture_that_a_busy_machine_reads_late_is_no_jump():
    clock = DeviceClock(LATENCY_NS)
    clock.arrived(0, START_NS + LATENCY_NS)
    offset = clock.arrived(PERIOD_NS, START_NS + PERIOD_NS + LATENCY_NS + 400_000_000)
    assert abs(offset.offset_ns - START_NS) < 100_000


def test_a_device_that_starts_again_is_named():
    clock = DeviceClock(LATENCY_NS)
    clock.arrived(9_000_000_000, START_NS)
    with pytest.raises(ClockJumped):
        clock.arrived(0, START_NS + PERIOD_NS)
    offset = clock.arrived(PERIOD_NS, START_NS + 2 * PERIOD_NS)
    assert offset.offset_ns == START_NS + PERIOD_NS - LATENCY_NS
