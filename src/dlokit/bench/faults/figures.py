"""Figures of what became of an arm whose commander was lost."""

import math
from collections.abc import Sequence

from dlokit.bench.faults.stopping import Stop, StopFigures
from dlokit.bench.report import Figure


def percentile_s(stops: Sequence[Stop], percent: float) -> float:
    """The time until braking began [s] that this many percent of the stops did not exceed; inf for one that never did.

    It is one of the times, not between two: with 100 stops the 99th percentile is the second longest.
    """
    times = sorted(math.inf if stop.began_s is None else stop.began_s for stop in stops)
    return times[max(math.ceil(percent / 100.0 * len(times)) - 1, 0)]


def stop_figures(figures: StopFigures) -> list[Figure]:
    """Rows for the JSON file; an arm that never braked has no figure but in the count."""
    rows: list[Figure] = []
    for case, stops in (("killed", figures.killed), ("frozen", figures.frozen)):
        if not stops:
            continue
        never = sum(stop.began_s is None for stop in stops)
        rows.append(_figure(case, "never braked", never, "1", len(stops)))
        for name, percent in (("p50", 50.0), ("p99", 99.0), ("max", 100.0)):
            value_s = percentile_s(stops, percent)
            if math.isfinite(value_s):
                rows.append(_figure(case, f"braking begins after, {name}", value_s, "s", len(stops)))
    rows.append(_figure("quiet", "false stops", figures.false_stops, "1", 1))
    rows.append(_figure("quiet", "time watched", figures.watched_s, "s", 1))
    return rows


def _figure(case: str, metric: str, value: float, unit: str, n: int) -> Figure:
    return Figure(case=case, method="dlokit", metric=metric, value=value, low=None, high=None, unit=unit, n=n)
