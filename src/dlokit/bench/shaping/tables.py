"""Tables of a sweep, for a terminal: rows of text."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from dlokit.bench.shaping import metrics
from dlokit.bench.shaping.cases import CaseResult
from dlokit.bench.shaping.rows import Row
from dlokit.bench.shaping.verdicts import confusion, goals_refuted
from dlokit.evaluation.statistics import success_rate

COLUMNS = (
    *("experiment", "method", "converged", "95 %", "actions", "by kind", "robot s", "path m"),
    *("RMSE mm", "true mm", "farthest mm", "plan s", "false"),
)
"""Headings of `overview`."""
_SHORT = {"pick-and-place": "pick", "lay-down": "lay"}


def overview(rows: Iterator[Row]) -> Iterator[tuple[str, ...]]:
    """A row of text a row: medians, the largest in brackets; kinds as actions of all runs together."""
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
            str(sum(map(metrics.falsely_converged, runs))),
        )


def outcomes(results: Sequence[CaseResult]) -> Iterator[str]:
    """A line a method: how its runs ended, and what became of the hopeless ones."""
    for method in dict.fromkeys(done.case.method.name for done in results):
        runs = [done.result for done in results if done.case.method.name == method]
        counted = Counter(run.outcome.value for run in runs).most_common()
        line = f"{method}: " + ", ".join(f"{count} {outcome}" for outcome, count in counted)
        if hopeless := [run for run in runs if metrics.is_hopeless(run)]:
            late = sum(metrics.idle_actions(run) > metrics.HOPELESS_ACTIONS for run in hopeless)
            line += f"; {len(hopeless)} hopeless, {late} of them went on for over {metrics.HOPELESS_ACTIONS} in vain"
        yield line


def verdict_lines(results: Sequence[CaseResult]) -> Iterator[str]:
    """What was said of goals, against what happened."""
    for method in dict.fromkeys(done.case.method.name for done in results):
        said = confusion([done for done in results if done.case.method.name == method])
        parts = [f"{verdict.value}: {wins} of {runs} reached" for verdict, (wins, runs) in said.items() if runs]
        yield f"{method}: {', '.join(parts) or 'no goal was judged'}"
    refuted, infeasible = goals_refuted(results)
    if infeasible:
        yield f"goals called infeasible that a run reached: {refuted} of {infeasible}"


def _kinds(row: Row) -> str:
    counted = Counter(action.kind for run in row.runs for action in run.history).most_common()
    return " ".join(f"{_SHORT.get(kind, kind)} {count}" for kind, count in counted) or "-"


def _median_and_most(values: Sequence[float], form: str) -> str:
    if not values:
        return "-"
    return f"{form.format(float(np.median(values)))} ({form.format(max(values))})"
