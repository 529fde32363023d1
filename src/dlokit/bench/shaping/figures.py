"""Every figure of a sweep with its interval, a row each: what ``--json`` writes."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np

from dlokit.bench.report import Figure, figure
from dlokit.bench.shaping import metrics
from dlokit.bench.shaping.cases import CaseResult
from dlokit.bench.shaping.rows import Row, experiment_rows, group_rows
from dlokit.bench.shaping.verdicts import verdict_figures
from dlokit.evaluation.statistics import Interval, bootstrap, median, success_rate, without_interval
from dlokit.system.results.run_result import RunResult

Value = Callable[[RunResult], float | None]

_PER_RUN: tuple[tuple[str, str, Value], ...] = (
    ("actions", "", lambda run: float(run.actions)),
    ("robot_time_s", "s", metrics.robot_time_s),
    ("path_length_m", "m", metrics.path_length_m),
    ("rmse_m", "m", lambda run: run.rmse_m),
    ("true_rmse_m", "m", lambda run: run.true_rmse_m),
    ("true_largest_m", "m", lambda run: run.true_largest_m),
    ("sim_time_s", "s", lambda run: run.sim_time_s),
    ("wall_time_s", "s", lambda run: run.wall_time_s),
)


def figures(results: Sequence[CaseResult]) -> list[Figure]:
    """Figures of each experiment, of the groups, and of the verdicts against what happened."""
    rows = chain(experiment_rows(results), group_rows(results))
    return [*chain.from_iterable(_row_figures(row) for row in rows), *verdict_figures(results)]


def _row_figures(row: Row) -> Iterator[Figure]:
    runs = row.runs
    yield _rate(row, "converged", sum(map(metrics.converged, runs)), len(runs))
    yield _rate(row, "false convergence", sum(map(metrics.falsely_converged, runs)), len(runs))
    for outcome, count in sorted(Counter(run.outcome.value for run in runs).items()):
        yield _rate(row, f"outcome {outcome}", count, len(runs))
    hopeless = [run for run in runs if metrics.is_hopeless(run)]
    if hopeless:
        stopped = sum(metrics.idle_actions(run) <= metrics.HOPELESS_ACTIONS for run in hopeless)
        yield _rate(row, "hopeless runs stopped in time", stopped, len(hopeless))
    for name, unit, value in _PER_RUN:
        values = [found for run in runs if (found := value(run)) is not None]
        if values:
            yield _figure(row, f"median {name}", median(values), unit)
            yield _figure(row, f"max {name}", without_interval(max(values), len(values)), unit)
    yield from _kinds(row)
    planning = [action.planning_time_s for run in runs for action in run.history]
    if planning:
        # Decisions of one run are not independent: these two have no interval.
        yield _figure(
            row, "median planning_time_s an action", without_interval(float(np.median(planning)), len(planning)), "s"
        )
        yield _figure(row, "max planning_time_s an action", without_interval(max(planning), len(planning)), "s")


def _kinds(row: Row) -> Iterator[Figure]:
    """Actions of each kind: their mean a run, as medians of rare kinds are all 0."""
    for kind in sorted({action.kind for run in row.runs for action in run.history}):
        counts = [float(sum(action.kind == kind for action in run.history)) for run in row.runs]
        yield _figure(row, f"mean actions, {kind}", bootstrap(counts, np.random.default_rng(0)), "")


def _rate(row: Row, metric: str, count: int, n: int) -> Figure:
    return _figure(row, metric, success_rate(count, n), "")


def _figure(row: Row, metric: str, interval: Interval, unit: str) -> Figure:
    return figure(row.name, row.method, metric, interval, unit)
