"""Figures of what became of an arm whose commander or feedback was lost, or that a person stopped."""

import math
from collections.abc import Sequence

from dlokit.benches.report import BenchFigure
from parts.stops.press_verdict import Press, PressRow
from parts.stops.stopping import ArmStop, StopFigures


def percentile_s(stops: Sequence[ArmStop], percent: float) -> float:
    """The time until braking began [s] that this many percent of the stops did not exceed; inf for one that never did.

    It is one of the times, not between two: with 100 stops the 99th percentile is the second longest.
    """
    return _percentile([stop.began_s for stop in stops], percent)


def confirmed_percentile_s(presses: Sequence[Press], percent: float) -> float:
    """The time until the confirmation [s] that this many percent of the stops did not exceed; inf: it never came."""
    return _percentile([press.confirmed_s for press in presses], percent)


def stop_figures(figures: StopFigures) -> list[BenchFigure]:
    """Rows for the JSON file; an arm that never braked has no figure but in the count."""
    rows: list[BenchFigure] = []
    for case, stops in figures.by_fault.items():
        never = sum(stop.began_s is None for stop in stops)
        rows.append(_figure(case, "never braked", never, "1", len(stops)))
        for name, percent in (("p50", 50.0), ("p99", 99.0), ("max", 100.0)):
            value_s = percentile_s(stops, percent)
            if math.isfinite(value_s):
                rows.append(_figure(case, f"braking begins after, {name}", value_s, "s", len(stops)))
    rows.append(_figure("quiet", "false stops", figures.false_stops, "1", 1))
    rows.append(_figure("quiet", "time watched", figures.watched_s, "s", 1))
    return rows


def press_figures(rows: Sequence[PressRow]) -> list[BenchFigure]:
    """Rows for the JSON file; a stop that was never confirmed has no time but in the count."""
    figures: list[BenchFigure] = []
    for row in rows:
        case, n = f"stop: {row.name}", len(row.presses)
        never = sum(press.confirmed_s is None for press in row.presses)
        figures.append(_figure(case, "never confirmed", never, "1", n))
        for name, percent in (("p50", 50.0), ("p99", 99.0), ("max", 100.0)):
            value_s = confirmed_percentile_s(row.presses, percent)
            if math.isfinite(value_s):
                figures.append(_figure(case, f"confirmed after, {name}", value_s, "s", n))
        figures.append(
            _figure(case, "joints moved after, max", max(press.moved_rad for press in row.presses), "rad", n)
        )
        figures.append(_figure(case, "fingers moved after, max", max(press.fingers_m for press in row.presses), "m", n))
        figures.append(_figure(case, "wrong", sum(bool(press.wrong) for press in row.presses), "1", n))
    return figures


def _percentile(times_s: Sequence[float | None], percent: float) -> float:
    times = sorted(math.inf if time_s is None else time_s for time_s in times_s)
    return times[max(math.ceil(percent / 100.0 * len(times)) - 1, 0)]


def _figure(case: str, metric: str, value: float, unit: str, n: int) -> BenchFigure:
    return BenchFigure(case=case, method="dlokit", metric=metric, value=value, low=None, high=None, unit=unit, n=n)
