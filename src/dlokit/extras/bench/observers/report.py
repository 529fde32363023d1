"""The report of the bench of observers: tables of figures as text, its JSON file, and a picture for each metric."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from dlokit.extras.bench.observers.cases import TUNING_SEED, ObserverCase
from dlokit.extras.bench.observers.methods import PINNED, PUBLISHED, default_name
from dlokit.extras.bench.observers.metrics import METRICS, Metric
from dlokit.extras.bench.observers.runner import BenchPlan
from dlokit.extras.bench.report import BenchFigure, bench_json

FigureKey = tuple[str, str, str]


def case_table(rows: Sequence[BenchFigure], metric: Metric) -> Iterator[tuple[str, ...]]:
    """One metric: a line per case that has it, a column per method."""
    found = by_key(rows)
    for case in dict.fromkeys(row.case for row in rows if row.metric == metric.name):
        yield (case, *(_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)))


def metric_table(rows: Sequence[BenchFigure], case: str) -> Iterator[tuple[str, ...]]:
    """One case: a line per metric that it has, a column per method."""
    found = by_key(rows)
    for metric in METRICS:
        if is_shown(metric, [row for row in rows if row.case == case]):
            cells = [_cell(found.get((case, method, metric.name)), metric) for method in methods_of(rows)]
            yield (f"{metric.name} {metric.shown}".rstrip(), *cells)


def is_shown(metric: Metric, rows: Sequence[BenchFigure]) -> bool:
    """Whether a metric has a figure to show."""
    return any(row.metric == metric.name and (row.value != 0.0 or not metric.rare) for row in rows)


def methods_of(rows: Sequence[BenchFigure]) -> tuple[str, ...]:
    """The methods with figures, in order."""
    return tuple(dict.fromkeys(row.method for row in rows))


def by_key(rows: Sequence[BenchFigure]) -> dict[FigureKey, BenchFigure]:
    """Rows by case, method and metric."""
    return {(row.case, row.method, row.metric): row for row in rows}


def shown(value: float, metric: Metric) -> str:
    """A figure as text for people."""
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
    config: dict[str, Any] = {
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
    }
    return bench_json("observers", rows, machine, config)


def _conditions(case: ObserverCase) -> dict[str, Any]:
    return {
        "motion": str(case.file) if case.file else case.motion,
        "pace": case.pace,
        **msgspec.to_builtins(case.conditions),
    }


_MARKERS = "osD^vP"  # another for every ten colours
_SPREAD = 0.8  # fraction of a case's band over which its methods are spread
_SEVERAL_POWERS = 20.0  # largest by smallest figure from which on the scale is logarithmic


def draw(rows: Sequence[BenchFigure], folder: Path) -> list[Path]:
    """A picture for each metric with figures, a band per case, from the top."""
    return [_draw(rows, metric, folder) for metric in METRICS if is_shown(metric, rows)]


def _draw(rows: Sequence[BenchFigure], metric: Metric, folder: Path) -> Path:
    here = [row for row in rows if row.metric == metric.name]
    cases = list(dict.fromkeys(row.case for row in here))
    methods = [method for method in methods_of(rows) if any(row.method == method for row in here)]
    names = list(dict.fromkeys(_plain(method) for method in methods))
    picture = Picture(figsize=(9.0, 1.2 + len(cases) * (0.15 + 0.09 * len(names))), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.add_subplot()
    for at in range(0, len(cases), 2):
        axes.axhspan(at - 0.5, at + 0.5, color="0.95", zorder=0)
    for method in methods:
        place = _SPREAD * ((names.index(_plain(method)) + 0.5) / len(names) - 0.5)
        _points(axes, here, metric, cases, method, place, _names(rows).index(_plain(method)))
    axes.set_yticks(range(len(cases)), cases)
    axes.set_ylim(len(cases) - 0.5, -0.5)
    axes.set_xlabel(f"{metric.name} [{metric.shown}]" if metric.shown else metric.name)
    values = [row.value for row in here]
    if min(values) > 0.0 and max(values) > _SEVERAL_POWERS * min(values):
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, axis="x", which="both", alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize="small", borderaxespad=0.0)
    path = folder / f"{metric.name.replace(', ', '-').replace(': ', '-').replace(' ', '-')}.png"
    picture.savefig(path, dpi=110)
    return path


def _points(
    axes: Axes,
    rows: Sequence[BenchFigure],
    metric: Metric,
    cases: Sequence[str],
    method: str,
    place: float,
    colour: int,
) -> None:
    found = by_key(rows)
    shown = [(at, row) for at, case in enumerate(cases) if (row := found.get((case, method, metric.name)))]
    x = np.array([row.value for _, row in shown]) * metric.factor
    ends = [(row.value if end is None else end) for _, row in shown for end in (row.low, row.high)]
    spread = np.abs(np.array(ends).reshape(-1, 2).T * metric.factor - x)
    # One line and colour per observer; a ring marks the result with a robot's pins, around the point if both are equal.
    ring = method.endswith(PINNED)
    axes.errorbar(
        x,
        [at + place for at, _ in shown],
        xerr=spread,
        fmt=_MARKERS[colour // 10 % len(_MARKERS)],
        markersize=7 if ring else 4,
        linewidth=1,
        color=f"C{colour % 10}",
        markerfacecolor="none" if ring else f"C{colour % 10}",
        label=method,
    )


def _names(rows: Sequence[BenchFigure]) -> list[str]:
    return list(dict.fromkeys(_plain(method) for method in methods_of(rows)))


def _plain(method: str) -> str:
    return method.removesuffix(PINNED)
