"""How much our bus adds to bare zenoh, beside bare pyzmq, and how old the messages are that a slow reader receives.

    python benchmarks/bus.py
    python benchmarks/bus.py --repeats 50 --slow-s 0 --json bus.json

Two processes of this machine send messages of five sizes, from a robot's state (200 bytes) to a pair of large pictures
(4 MB), and calls with such arguments. Every method sends one after the other in turns, so that other load of the
machine falls on all alike. Prints the median and the 5 % and 95 % quantiles for each method, with the ratio to bare
zenoh in the same run. Then a topic at 100 Hz has readers that need 50 ms for each message: waiting, blocking their
event loop, or keeping the interpreter. Prints the age of each message when it was read, and what `publish` took.

pyzmq is timed where it is installed: pip install '.[bench]'.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from parts.bus_load import SIZES_BYTES, Delay
from parts.bus_near_end import compare
from parts.bus_slow_reader import SlowTimes, measure_slow_readers
from parts.command import check_json, run_study, write_figures

ONE_WAY, CALL = "one way", "call"
BESIDE = {ONE_WAY: "zenoh", CALL: "zenoh, asyncio"}
"""What the ratio is taken to: zenoh's callback for messages, zenoh through asyncio at both ends for calls."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Time messages and calls between two processes, beside bare zenoh and bare pyzmq in turns."""

    repeats: int = 200
    """Messages and calls of each size with each method."""
    slow_s: float = 5.0
    """Seconds of a topic at 100 Hz for each kind of slow reader; 0: none."""
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if args.repeats < 1 or args.slow_s < 0:
        raise ConfigError(f"--repeats {args.repeats} must be at least 1, and --slow-s {args.slow_s} not negative.")
    check_json(args.json)
    console = Console()
    with console.status("starting") as status:
        said = status.update if console.is_terminal else console.print
        times = compare(args.repeats, said)
        slow = measure_slow_readers(args.slow_s, said) if args.slow_s else []
    rows: list[BenchFigure] = []
    for kind, delays in ((ONE_WAY, times.one_way), (CALL, times.calls)):
        console.print(_table(kind, delays))
        rows.extend(_figures(kind, delays))
    if slow:
        console.print(_slow_table(slow))
        rows.extend(_slow_figures(slow))
    config = {"repeats": args.repeats, "slow_s": args.slow_s}
    write_figures(args.json, "bus", rows, config, console)
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


if __name__ == "__main__":
    run_study(Args, run, __doc__)
