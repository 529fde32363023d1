"""What the bench of observers prints and writes: tables for people, rows of JSON for programs, a picture a metric."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from dlokit import __version__
from dlokit.bench.observers.cases import TUNING_SEED
from dlokit.bench.observers.methods import PINNED, default_name
from dlokit.bench.observers.metrics import METRICS, Metric
from dlokit.bench.observers.runner import Plan, Trial
from dlokit.bench.report import Figure
from dlokit.bench.statistics import bootstrap

FigureKey = tuple[str, str, str]


def figures(trials: Sequence[Trial]) -> list[Figure]:
    """A row for each case, method and metric: the mean over its sequences, with a 95 % interval.

    The interval is bootstrapped over sequences: frames of one sequence depend on one another.
    """
    rows: list[Figure] = []
    for case in dict.fromkeys(trial.case for trial in trials):
        for method in dict.fromkeys(trial.method for trial in trials):
            done = [trial for trial in trials if trial.case == case and trial.method == method]
            for metric in METRICS:
                values = [trial.figures[metric.name] for trial in done if metric.name in trial.figures]
                if not values:
                    continue
                # The resampling has a seed of its own: the same trials give the same interval.
                interval = bootstrap(values, np.random.default_rng(0))
                rows.append(
                    Figure(
                        case=case,
                        method=method,
                        metric=metric.name,
                        value=interval.value,
                        low=interval.low,
                        high=interval.high,
                        unit=metric.unit,
                        n=interval.n,
                    )
                )
    return rows


def observers_json(rows: Sequence[Figure], machine: Mapping[str, str], plan: Plan) -> bytes:
    """The file that ``--json`` writes; `config.default` names the default observer."""
    content: dict[str, Any] = {
        "bench": "observers",
        "version": __version__,
        "machine": dict(machine),
        "config": {
            "default": default_name(),
            "methods": {method.name: msgspec.to_builtins(method.config) for method in plan.methods},
            "cases": {case.name: _conditions(case) for case in plan.cases},
            "seeds": [plan.first_seed, plan.first_seed + plan.seeds - 1],
            "tuning_seeds_from": TUNING_SEED,
            "frames": plan.frames,
        },
        "rows": [asdict(row) for row in rows],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=2) + b"\n"


def _conditions(case: Any) -> dict[str, Any]:
    return {
        "motion": str(case.file) if case.file else case.motion,
        "pace": case.pace,
        **msgspec.to_builtins(case.conditions),
    }


def case_table(rows: Sequence[Figure], metric: Metric) -> Iterator[tuple[str, ...]]:
    """One metric: a line a case, a column a method."""
    found = _by_key(rows)
    for case in dict.fromkeys(row.case for row in rows):
        yield (case, *(_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)))


def metric_table(rows: Sequence[Figure], case: str) -> Iterator[tuple[str, ...]]:
    """One case: a line a metric, a column a method."""
    found = _by_key(rows)
    for metric in METRICS:
        cells = [_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)]
        yield (f"{metric.name} {metric.shown}", *cells)


def methods_of(rows: Sequence[Figure]) -> tuple[str, ...]:
    """The methods there are figures of, in order."""
    return tuple(dict.fromkeys(row.method for row in rows))


def draw(rows: Sequence[Figure], folder: Path) -> list[Path]:
    """A picture for each metric: every case and method with its interval."""
    return [_draw(rows, metric, folder) for metric in METRICS if any(row.metric == metric.name for row in rows)]


def _draw(rows: Sequence[Figure], metric: Metric, folder: Path) -> Path:
    cases = list(dict.fromkeys(row.case for row in rows))
    methods = methods_of(rows)
    names = list(dict.fromkeys(_plain(method) for method in methods))
    found = _by_key(rows)
    picture = Picture(figsize=(2.0 + 0.9 * len(cases), 4.5), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.add_subplot()
    for number, method in enumerate(methods):
        shown = [(at, row) for at, case in enumerate(cases) if (row := found.get((case, method, metric.name)))]
        x = [at + 0.7 * ((number + 0.5) / len(methods) - 0.5) for at, _ in shown]
        y = np.array([row.value for _, row in shown]) * metric.factor
        ends = [(row.value if end is None else end) for _, row in shown for end in (row.low, row.high)]
        spread = np.abs(np.array(ends).reshape(-1, 2).T * metric.factor - y)
        # One colour an observer; with a robot's pins it has the same colour, hollow.
        pinned = method.endswith(PINNED)
        colour = f"C{names.index(_plain(method))}"
        axes.errorbar(
            x,
            y,
            yerr=spread,
            fmt="o",
            markersize=4,
            color=colour,
            markerfacecolor="none" if pinned else colour,
            label=method,
        )
    axes.set_xticks(range(len(cases)), cases, rotation=35, ha="right")
    axes.set_ylabel(f"{metric.name} [{metric.shown}]")
    if metric.name != "frames over 50 mm" and all(row.value > 0.0 for row in rows if row.metric == metric.name):
        axes.set_yscale("log")
    axes.grid(visible=True, alpha=0.3)
    axes.legend(fontsize="small", ncols=2)
    path = folder / f"{metric.name.replace(', ', '-').replace(' ', '-')}.png"
    picture.savefig(path, dpi=120)
    return path


def _by_key(rows: Sequence[Figure]) -> dict[FigureKey, Figure]:
    return {(row.case, row.method, row.metric): row for row in rows}


def _plain(method: str) -> str:
    return method.removesuffix(PINNED)


def _cell(row: Figure | None, metric: Metric) -> str:
    if row is None:
        return "-"
    text = f"{row.value * metric.factor:.1f}"
    if row.low is None or row.high is None:
        return text
    return f"{text} ({row.low * metric.factor:.1f} to {row.high * metric.factor:.1f})"
