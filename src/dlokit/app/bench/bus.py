"""`dlokit bench bus`: the bus beside bare zenoh and bare pyzmq, and what a slow reader reads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.bench.bus.comparison import compare
from dlokit.bench.bus.load import SIZES_BYTES, Delay
from dlokit.bench.bus.slow_reader import SlowTimes, measure_slow_readers
from dlokit.bench.report import BenchFigure, bench_json, figure
from dlokit.errors import ConfigError
from dlokit.evaluation.statistics import median
from dlokit.system.results.run_record import machine_facts

ONE_WAY, CALL = "one way", "call"
BESIDE = {ONE_WAY: "zenoh", CALL: "zenoh, asyncio"}
"""What the ratio is taken to: zenoh's callback for messages, zenoh through asyncio at both ends for calls."""


@dataclass(frozen=True, kw_only=True)
class BusArgs:
    """Time messages and calls between two processes, beside bare zenoh and bare pyzmq in turns."""

    repeats: int = 200
    """Messages and calls of each size with each method."""
    slow_s: float = 5.0
    """Seconds of a topic at 100 Hz for each kind of slow reader; 0: none."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write every figure to this file."""


def run_bus(args: BusArgs) -> int:
    """Measure and print; exit code 0."""
    if args.repeats < 1 or args.slow_s < 0:
        raise ConfigError(f"--repeats {args.repeats} must be at least 1, and --slow-s {args.slow_s} not negative.")
    console = Console()
    times = compare(args.repeats)
    rows: list[BenchFigure] = []
    for kind, delays in ((ONE_WAY, times.one_way), (CALL, times.calls)):
        console.print(_table(kind, delays))
        rows.extend(_figures(kind, delays))
    slow = measure_slow_readers(args.slow_s) if args.slow_s else []
    if slow:
        console.print(_slow_table(slow))
        rows.extend(_slow_figures(slow))
    if args.json is not None:
        config = {"repeats": args.repeats, "slow_s": args.slow_s}
        args.json.write_bytes(bench_json("bus", rows, machine_facts(), config))
        console.print(f"figures: {args.json}")
    return 0


def by_method(delays: Sequence[Delay], size: int) -> dict[str, list[float]]:
    """Seconds of each method for messages of one size, in the order of their names."""
    found: dict[str, list[float]] = {}
    for delay in delays:
        if delay.size == size:
            found.setdefault(delay.method, []).append(delay.seconds)
    return dict(sorted(found.items()))


def _table(kind: str, delays: Sequence[Delay]) -> Table:
    table = Table(title=kind, caption=f"median µs (5 % to 95 %); ratio to {BESIDE[kind]} in the same run")
    for heading in ("bytes", "method", "µs", "ratio"):
        table.add_column(heading, justify="left" if heading == "method" else "right")
    for size in SIZES_BYTES:
        methods = by_method(delays, size)
        for name, seconds in methods.items():
            low, middle, high = np.quantile(seconds, (0.05, 0.5, 0.95)) * 1e6
            ratio = np.median(seconds) / np.median(methods[BESIDE[kind]])
            table.add_row(str(size), name, f"{middle:.0f} ({low:.0f} to {high:.0f})", f"{ratio:.2f}")
        table.add_section()
    return table


def _figures(kind: str, delays: Sequence[Delay]) -> list[BenchFigure]:
    return [
        figure(f"{size} bytes", name, f"median time {kind}", median(seconds), "s")
        for size in SIZES_BYTES
        for name, seconds in by_method(delays, size).items()
    ]


def _slow_table(slow: Sequence[SlowTimes]) -> Table:
    table = Table(title="a reader of a topic at 100 Hz", caption="age when read, and what the publisher spends on it")
    for heading in ("reader", "read", "age ms: median", "99 %", "publish µs: median", "99 %"):
        table.add_column(heading, justify="left" if heading == "reader" else "right")
    for times in slow:
        ages, puts = np.quantile(times.ages_s, (0.5, 0.99)) * 1e3, np.quantile(times.puts_s, (0.5, 0.99)) * 1e6
        table.add_row(
            times.way, str(len(times.ages_s)), f"{ages[0]:.1f}", f"{ages[1]:.1f}", f"{puts[0]:.0f}", f"{puts[1]:.0f}"
        )
    return table


def _slow_figures(slow: Sequence[SlowTimes]) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    for times in slow:
        rows.append(figure(times.way, "dlokit", "median age when read", median(times.ages_s), "s"))
        rows.append(_quantile(times.way, "99 % of ages when read", times.ages_s))
        rows.append(figure(times.way, "dlokit", "median time of publish", median(times.puts_s), "s"))
        rows.append(_quantile(times.way, "99 % of times of publish", times.puts_s))
    return rows


def _quantile(case: str, metric: str, values: Sequence[float]) -> BenchFigure:
    value = float(np.quantile(values, 0.99))
    return BenchFigure(
        case=case, method="dlokit", metric=metric, value=value, low=None, high=None, unit="s", n=len(values)
    )


COMMAND = CliCommand(BusArgs, run_bus)
