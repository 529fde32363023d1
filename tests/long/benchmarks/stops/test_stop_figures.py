"""Statistics of stops: percentiles are measured times, and an arm that never braked has none."""

import math

from parts.stops.braking import FROZEN, KILLED, ArmStop, Braking
from stops import braking_figures, holds_the_bar, percentile_s


def stops(*began_s: float | None) -> tuple[ArmStop, ...]:
    return tuple(ArmStop(began_s=value, stood_s=None if value is None else value + 0.1) for value in began_s)


def measured(killed: tuple[ArmStop, ...], false_stops: int = 0) -> Braking:
    return Braking(by_fault={KILLED: killed, FROZEN: stops(0.2)}, watched_s=60.0, false_stops=false_stops)


def test_a_percentile_is_a_measured_time() -> None:
    hundred = [number / 1000 for number in range(1, 101)]
    assert percentile_s(hundred, 50.0) == 0.050
    assert percentile_s(hundred, 99.0) == 0.099
    assert percentile_s(hundred, 100.0) == 0.100
    assert percentile_s([0.1], 50.0) == 0.1


def test_an_arm_that_never_braked_ranks_last() -> None:
    assert percentile_s([0.1, None, 0.2], 100.0) == math.inf
    rows = {(row.case, row.metric): row.value for row in braking_figures(measured(stops(0.1, None, 0.2)))}
    assert rows["commander killed", "never braked"] == 1
    assert rows["commander killed", "braking begins after, p50"] == 0.2
    assert ("commander killed", "braking begins after, max") not in rows


def test_the_bound_requires_99_of_100_in_time_and_no_false_brake() -> None:
    one_late = stops(*[0.2] * 99, 0.4)
    assert holds_the_bar(measured(one_late))
    assert not holds_the_bar(measured(stops(*[0.2] * 98, 0.4, 0.4)))
    assert not holds_the_bar(measured(stops(0.2, None)))
    assert not holds_the_bar(measured(stops(0.2), false_stops=1))
