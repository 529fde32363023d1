"""The report of the bench of observers: tables of figures as text, and its JSON file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import msgspec

from dlokit import __version__
from dlokit.bench.observers.cases import TUNING_SEED, ObserverCase
from dlokit.bench.observers.methods import PUBLISHED, default_name
from dlokit.bench.observers.metrics import METRICS, Metric
from dlokit.bench.observers.runner import BenchPlan
from dlokit.bench.report import BenchFigure

FigureKey = tuple[str, str, str]


def case_table(rows: Sequence[BenchFigure], metric: Metric) -> Iterator[tuple[str, ...]]:
    """One metric: a line a case that has it, a column a method."""
    found = by_key(rows)
    for case in dict.fromkeys(row.case for row in rows if row.metric == metric.name):
        yield (case, *(_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)))


def metric_table(rows: Sequence[BenchFigure], case: str) -> Iterator[tuple[str, ...]]:
    """One case: a line a metric that it has, a column a method."""
    found = by_key(rows)
    for metric in METRICS:
        if is_shown(metric, [row for row in rows if row.case == case]):
            cells = [_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)]
            yield (f"{metric.name} {metric.shown}".rstrip(), *cells)


def is_shown(metric: Metric, rows: Sequence[BenchFigure]) -> bool:
    """Whether there is something to see of a metric."""
    return any(row.metric == metric.name and (row.value != 0.0 or not metric.rare) for row in rows)


def methods_of(rows: Sequence[BenchFigure]) -> tuple[str, ...]:
    """The methods there are figures of, in order."""
    return tuple(dict.fromkeys(row.method for row in rows))


def by_key(rows: Sequence[BenchFigure]) -> dict[FigureKey, BenchFigure]:
    """Rows by case, method and metric."""
    return {(row.case, row.method, row.metric): row for row in rows}


def shown(value: float, metric: Metric) -> str:
    """A figure as people read it."""
    return f"{value * metric.factor:.{metric.digits}f}"


def _cell(row: BenchFigure | None, metric: Metric) -> str:
    if row is None:
        return "-"
    text = shown(row.value, metric)
    if row.low is None or row.high is None:
        return text
    return f"{text} ({shown(row.low, metric)} to {shown(row.high, metric)})"


def observers_json(rows: Sequence[BenchFigure], machine: Mapping[str, str], plan: BenchPlan, *, jobs: int = 1) -> bytes:
    """The file that ``--json`` writes; `config.default` names the default observer."""
    content: dict[str, Any] = {
        "bench": "observers",
        "version": __version__,
        "machine": dict(machine),
        "config": {
            "default": default_name(),
            "peers": [name for name in PUBLISHED if name != default_name()],
            "methods": {method.name: msgspec.to_builtins(method.config) for method in plan.methods},
            "cases": {case.name: _conditions(case) for case in plan.cases},
            "seeds": [plan.first_seed, plan.first_seed + plan.seeds - 1],
            "tuning_seeds_from": TUNING_SEED,
            "frames": plan.frames,
            "jobs": jobs,
            "threads_a_process": 1,
            "times_comparable": jobs == 1,
        },
        "rows": [asdict(row) for row in rows],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def _conditions(case: ObserverCase) -> dict[str, Any]:
    return {
        "motion": str(case.file) if case.file else case.motion,
        "pace": case.pace,
        **msgspec.to_builtins(case.conditions),
    }
