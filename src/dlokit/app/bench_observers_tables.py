"""What `dlokit bench observers` prints when it is done."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from dlokit.bench.observers.figures import ALL_CASES
from dlokit.bench.observers.methods import default_name
from dlokit.bench.observers.metrics import METRICS, Metric
from dlokit.bench.observers.runner import Plan
from dlokit.bench.observers.summary import HALF, Bar, Compared, bars
from dlokit.bench.observers.tables import by_key, case_table, methods_of, metric_table, shown
from dlokit.bench.report import Figure

_METRIC = {metric.name: metric for metric in METRICS}


def print_figures(rows: Sequence[Figure], console: Console, *, comparable: bool) -> None:
    """Node errors of every case, every metric of the first one, and what health is worth over all."""
    methods = methods_of(rows)
    first = rows[0].case
    tables = [
        _table(f"node error, {METRICS[0].shown}", "case", methods, list(case_table(rows, METRICS[0]))),
        _table(f"case {first!r}, every metric", "metric", methods, list(metric_table(rows, first))),
    ]
    if over_all := list(metric_table(rows, ALL_CASES)):
        tables.append(_table("all cases, what health is worth", "metric", methods, over_all))
    # A table that folds its figures cannot be read: a narrow or unknown width is overruled.
    wide = Console(width=max(console.width, 34 + 24 * len(methods)))
    for table in tables:
        wide.print(table)
    times = "times are processor time a frame, one thread"
    if not comparable:
        times += "; NOT comparable, because processes ran side by side"
    console.print(f"default observer: {default_name()}; {times}", highlight=False)


def print_summary(rows: Sequence[Figure], compared: Sequence[Compared], plan: Plan, console: Console) -> None:
    """The default observer, without pins, against the best peer and against the bars."""
    wide = Console(width=max(console.width, 100))
    if compared:
        table = Table(title=f"{default_name()} against the best peer, node error", caption=f"bar: at most {HALF}")
        for heading in ("case", f"{default_name()} mm", "best peer mm", "peer", "ratio (95 %)", ""):
            table.add_column(heading, no_wrap=True, justify="left" if heading in ("case", "peer", "") else "right")
        for one in compared:
            low, high = one.figure.low, one.figure.high
            interval = "" if low is None or high is None else f" ({low:.2f} to {high:.2f})"
            verdict = ("met" if one.met else "MISSED") if one.has_bar else "no bar"
            ratio = f"{one.figure.value:.2f}{interval}"
            table.add_row(one.case, f"{one.own_m * 1e3:.1f}", f"{one.peer_m * 1e3:.1f}", one.peer, ratio, verdict)
        wide.print(table)
    lines = [line for bar in bars(plan.cases) if (line := _bar_line(bar, rows)) is not None]
    if lines:
        table = Table(title=f"bars, default observer {default_name()}")
        for heading in ("case", "metric", "figure", "bar", ""):
            table.add_column(heading, no_wrap=True, justify="right" if heading in ("figure", "bar") else "left")
        for line in lines:
            table.add_row(*line)
        wide.print(table)


def _bar_line(bar: Bar, rows: Sequence[Figure]) -> tuple[str, ...] | None:
    row = by_key(rows).get((bar.case, bar.method or default_name(), bar.metric))
    if row is None:
        return None
    metric = _METRIC.get(bar.metric) or Metric(name=bar.metric, unit=row.unit, factor=1.0, shown="")
    limit = f"{'≥' if bar.is_least else '≤'} {shown(bar.most, metric)} {metric.shown}".rstrip()
    what = bar.metric if bar.method is None else f"{bar.metric}, {bar.method}"
    return bar.case, what, shown(row.value, metric), limit, "met" if bar.met(row.value) else "MISSED"


def _table(title: str, first: str, methods: Sequence[str], lines: Sequence[tuple[str, ...]]) -> Table:
    table = Table(title=title, caption="mean over sequences (95 % interval)")
    table.add_column(first, no_wrap=True)
    for method in methods:
        table.add_column(method, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    return table
