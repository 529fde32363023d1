"""What is counted: how often verdicts are right, how often each is said, and what one costs."""

from collections.abc import Sequence

import numpy as np

from dlokit.bench.feasibility.beliefs import Level
from dlokit.bench.feasibility.cases import Judged
from dlokit.bench.feasibility.releases import Happened
from dlokit.bench.report import BenchFigure, figure
from dlokit.evaluation.statistics import success_rate, without_interval
from dlokit.types.feasibility import Standing

ALL = "all"


def figures(rows: Sequence[Judged]) -> list[BenchFigure]:
    """For all DLOs, then for each, at each level of knowledge."""
    found: list[BenchFigure] = []
    for dlo in (ALL, *dict.fromkeys(row.dlo for row in rows)):
        for level in Level:
            of = [row for row in rows if row.level is level and dlo in (ALL, row.dlo)]
            found += _rates(dlo, level, of)
            if dlo == ALL:
                found += _seconds(level, of)
    return found


def is_right(row: Judged) -> bool:
    """Whether *holds* stayed, or *infeasible* was not reached; *doubtful* is never wrong."""
    match row.standing:
        case Standing.HOLDS:
            return row.happened is Happened.STAYED
        case Standing.INFEASIBLE:
            return row.happened is Happened.MISSED
        case Standing.DOUBTFUL:
            return True


def _rates(dlo: str, level: Level, rows: Sequence[Judged]) -> list[BenchFigure]:
    found: list[BenchFigure] = []
    for standing in Standing:
        said = [row for row in rows if row.standing is standing]
        if standing is not Standing.DOUBTFUL:
            found += _rate(dlo, level, f"{standing.value} is right", [is_right(row) for row in said])
        found += _rate(dlo, level, f"said {standing.value}", [row.standing is standing for row in rows])
    stayed = [row.standing is Standing.HOLDS for row in rows if row.happened is Happened.STAYED]
    missed = [row.standing is Standing.INFEASIBLE for row in rows if row.happened is Happened.MISSED]
    return [
        *found,
        *_rate(dlo, level, "of goals that stay, said holds", stayed),
        *_rate(dlo, level, "of goals missed, said infeasible", missed),
    ]


def _rate(dlo: str, level: Level, metric: str, hits: Sequence[bool]) -> list[BenchFigure]:
    """A share with its Clopper-Pearson interval; none of nothing."""
    if not hits:
        return []
    return [figure(dlo, level.value, metric, success_rate(sum(hits), len(hits)), "")]


def _seconds(level: Level, rows: Sequence[Judged]) -> list[BenchFigure]:
    if not rows:
        return []
    seconds = np.array([row.verdict_s for row in rows])
    values = {"median": np.median(seconds), "95th percentile": np.percentile(seconds, 95.0), "largest": seconds.max()}
    return [
        figure(
            ALL,
            level.value,
            f"processor time of a verdict, {name}",
            without_interval(float(value), len(rows)),
            "s",
        )
        for name, value in values.items()
    ]
