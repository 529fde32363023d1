"""Every figure of a sweep with its interval: rows for ``--json``, tables for a terminal."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping import metrics
from dlokit.extras.bench.shaping.cases import CaseResult, judged_by_truth
from dlokit.extras.bench.shaping.metrics import reached, standing
from dlokit.extras.bench.shaping.post_figures import fixture_figures
from dlokit.extras.bench.statistics import Interval, bootstrap, median, success_rate, without_interval
from dlokit.system.results.run_result import RunResult
from dlokit.types.action import facts_of
from dlokit.types.feasibility import Standing

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class FigureRow:
    """The runs of one method from which a figure is computed."""

    name: str
    method: str
    results: tuple[CaseResult, ...]

    @property
    def runs(self) -> list[RunResult]:
        """Result of each run."""
        return [done.result for done in self.results]


def experiment_rows(results: Sequence[CaseResult]) -> Iterator[FigureRow]:
    """One row per experiment and method."""
    for name in dict.fromkeys(done.case.experiment.name for done in results):
        yield from _rows(name, [done for done in results if done.case.experiment.name == name])


def group_rows(results: Sequence[CaseResult]) -> Iterator[FigureRow]:
    """Rows of the suite's groups, of each verdict, and of all runs."""
    for group in dict.fromkeys(group for done in results for group in done.case.experiment.groups):
        yield from _rows(group, [done for done in results if group in done.case.experiment.groups])
    for verdict in Standing:
        yield from _rows(verdict_row(verdict), [done for done in results if standing(done.result) is verdict])
    yield from _rows(ALL, results)


def verdict_row(verdict: Standing) -> str:
    """The name of the row of all runs with that verdict."""
    return f"verdict {verdict.value}"


def _rows(name: str, results: Sequence[CaseResult]) -> Iterator[FigureRow]:
    for method in dict.fromkeys(done.case.method.name for done in results):
        yield FigureRow(
            name=name, method=method, results=tuple(done for done in results if done.case.method.name == method)
        )


VERDICTS = "verdicts"
"""The case of these figures."""
ANY = "any"
"""Name of the method in figures of all methods together."""


def confusion(results: Sequence[CaseResult]) -> dict[Standing, tuple[int, int]]:
    """Runs that reached the goal, and all runs, by the verdict on the goal."""
    counts: dict[Standing, tuple[int, int]] = {}
    for verdict in Standing:
        said = [done.result for done in results if standing(done.result) is verdict]
        counts[verdict] = (sum(map(reached, said)), len(said))
    return counts


def goals_refuted(results: Sequence[CaseResult]) -> tuple[int, int]:
    """The number of infeasible verdicts that a run in the same cell refuted, and the number of all infeasible verdicts.

    A goal in the cell of another seed counts as another goal: feasibility depends on friction and stiffness.
    """
    infeasible = {_goal(done) for done in results if standing(done.result) is Standing.INFEASIBLE}
    reached_goals = {_goal(done) for done in results if reached(done.result)}
    return len(infeasible & reached_goals), len(infeasible)


def kept(results: Sequence[CaseResult]) -> dict[Standing, tuple[int, int]]:
    """Numbers of experiments by the verdict on their goal in the first run of each, with the number of all judged."""
    first: dict[str, Standing] = {}
    for done in results:
        said = standing(done.result)
        if said is not None:
            first.setdefault(done.case.experiment.name, said)
    return {verdict: (sum(said is verdict for said in first.values()), len(first)) for verdict in Standing}


def verdict_figures(results: Sequence[CaseResult]) -> Iterator[BenchFigure]:
    """Rates: feasible goals reached, goals by verdict, and goals wrongly rejected.

    Without a truth the success is called *converged*, because only the system under test judges it.
    """
    truth = judged_by_truth(results)
    for method in dict.fromkeys(done.case.method.name for done in results):
        of_method = [done for done in results if done.case.method.name == method]
        for verdict, (wins, runs) in confusion(of_method).items():
            if runs:
                yield _verdict_rate(method, f"{_reached(truth)}, said {verdict.value}", wins, runs)
    refuted, infeasible = goals_refuted(results)
    if infeasible:
        metric = "infeasible goals that a run reached" if truth else "infeasible goals that a run converged to"
        yield _verdict_rate(ANY, metric, refuted, infeasible)
    for verdict, (count, goals) in kept(results).items():
        if goals:
            yield _verdict_rate(ANY, f"goals said {verdict.value}", count, goals)


def _reached(truth: bool) -> str:
    return "reached" if truth else "converged"


def _goal(done: CaseResult) -> tuple[str, int]:
    return done.case.experiment.name, done.case.seed


def _verdict_rate(method: str, metric: str, count: int, n: int) -> BenchFigure:
    return figure(VERDICTS, method, metric, success_rate(count, n), "")


COLUMNS = (
    *("experiment", "method", "converged", "95 %", "actions", "by kind", "robot s", "path m"),
    *("RMSE mm", "true mm", "farthest mm", "plan s", "false"),
)
"""Headings of `overview`."""


def overview(rows: Iterator[FigureRow], *, truth: bool) -> Iterator[tuple[str, ...]]:
    """The rows as text: medians, with the largest in brackets; kinds as numbers of actions in all runs.

    `truth`: the ground truth judges; without it no success is known to be false.
    """
    for row in rows:
        runs = row.runs
        wins = sum(map(metrics.converged, runs))
        rate = success_rate(wins, len(runs))
        planning = [action.planning_time_s for run in runs for action in run.history]
        yield (
            row.name,
            row.method,
            f"{wins}/{len(runs)}",
            f"{rate.low:.2f}-{rate.high:.2f}",
            _median_and_most([run.actions for run in runs], "{:.3g}"),
            _kinds(row),
            _median_and_most([metrics.robot_time_s(run) for run in runs], "{:.0f}"),
            _median_and_most([metrics.path_length_m(run) for run in runs], "{:.1f}"),
            _median_and_most([run.rmse_m * 1e3 for run in runs if run.rmse_m is not None], "{:.1f}"),
            _median_and_most([run.true_rmse_m * 1e3 for run in runs if run.true_rmse_m is not None], "{:.1f}"),
            _median_and_most([run.true_largest_m * 1e3 for run in runs if run.true_largest_m is not None], "{:.0f}"),
            _median_and_most(planning, "{:.2f}"),
            str(sum(map(metrics.falsely_converged, runs))) if truth else "-",
        )


def outcomes(results: Sequence[CaseResult]) -> Iterator[str]:
    """One line per method: the outcomes of its runs, and the results of runs without expected progress."""
    for method in dict.fromkeys(done.case.method.name for done in results):
        runs = [done.result for done in results if done.case.method.name == method]
        counted = Counter(run.outcome.value for run in runs).most_common()
        line = f"{method}: " + ", ".join(f"{count} {outcome}" for outcome, count in counted)
        if idle := [run for run in runs if metrics.is_without_progress(run)]:
            late = sum(metrics.idle_actions(run) > metrics.NO_PROGRESS_ACTIONS for run in idle)
            line += f"; {len(idle)} without expected progress"
            line += f", {late} of them over {metrics.NO_PROGRESS_ACTIONS} actions"
        yield line


def verdict_lines(results: Sequence[CaseResult]) -> Iterator[str]:
    """Verdicts on goals compared with the outcomes."""
    truth = judged_by_truth(results)
    word = _reached(truth)
    for method in dict.fromkeys(done.case.method.name for done in results):
        said = confusion([done for done in results if done.case.method.name == method])
        parts = [f"{verdict.value}: {wins} of {runs} {word}" for verdict, (wins, runs) in said.items() if runs]
        yield f"{method}: {', '.join(parts) or 'no goal was judged'}"
    refuted, infeasible = goals_refuted(results)
    if infeasible:
        yield f"goals called infeasible that a run {word}{'' if truth else ' to'}: {refuted} of {infeasible}"


def _kinds(row: FigureRow) -> str:
    counted = Counter(action.kind for run in row.runs for action in run.history).most_common()
    return " ".join(f"{facts_of(kind).short or kind} {count}" for kind, count in counted) or "-"


def _median_and_most(values: Sequence[float], form: str) -> str:
    if not values:
        return "-"
    return f"{form.format(float(np.median(values)))} ({form.format(max(values))})"


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


def figures(results: Sequence[CaseResult]) -> list[BenchFigure]:
    """Figures of each experiment, of the groups, of the verdicts compared with the outcomes, and of fixtures."""
    rows = chain(experiment_rows(results), group_rows(results))
    truth = judged_by_truth(results)
    of_rows = chain.from_iterable(_row_figures(row, truth) for row in rows)
    return [*of_rows, *verdict_figures(results), *fixture_figures(results)]


def _row_figures(row: FigureRow, truth: bool) -> Iterator[BenchFigure]:
    runs = row.runs
    yield _rate(row, "converged", sum(map(metrics.converged, runs)), len(runs))
    if truth:
        yield _rate(row, "false convergence", sum(map(metrics.falsely_converged, runs)), len(runs))
    for outcome, count in sorted(Counter(run.outcome.value for run in runs).items()):
        yield _rate(row, f"outcome {outcome}", count, len(runs))
    without_progress = [run for run in runs if metrics.is_without_progress(run)]
    if without_progress:
        stopped = sum(metrics.idle_actions(run) <= metrics.NO_PROGRESS_ACTIONS for run in without_progress)
        yield _rate(row, "runs without expected progress stopped in time", stopped, len(without_progress))
    for name, unit, value in _PER_RUN:
        values = [found for run in runs if (found := value(run)) is not None]
        if values:
            yield _figure(row, f"median {name}", median(values), unit)
            yield _figure(row, f"max {name}", without_interval(max(values), len(values)), unit)
    yield from _kind_figures(row)
    planning = [action.planning_time_s for run in runs for action in run.history]
    if planning:
        # Decisions of one run are not independent: these two have no interval.
        yield _figure(
            row, "median planning_time_s an action", without_interval(float(np.median(planning)), len(planning)), "s"
        )
        yield _figure(row, "max planning_time_s an action", without_interval(max(planning), len(planning)), "s")


def _kind_figures(row: FigureRow) -> Iterator[BenchFigure]:
    """Actions of each kind: their mean a run, as medians of rare kinds are all 0."""
    for kind in sorted({action.kind for run in row.runs for action in run.history}):
        counts = [float(sum(action.kind == kind for action in run.history)) for run in row.runs]
        yield _figure(row, f"mean actions, {kind}", bootstrap(counts, np.random.default_rng(0)), "")


def _rate(row: FigureRow, metric: str, count: int, n: int) -> BenchFigure:
    return _figure(row, metric, success_rate(count, n), "")


def _figure(row: FigureRow, metric: str, interval: Interval, unit: str) -> BenchFigure:
    return figure(row.name, row.method, metric, interval, unit)
