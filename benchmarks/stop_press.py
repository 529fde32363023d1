"""How much processor time `dlokit stop` uses before it presses the stop sockets, and what it imports before.

    python benchmarks/stop_press.py
    python benchmarks/stop_press.py --times 20

Each time a new process presses a socket that this study serves. Beside it stands the processor time of
`python -c pass`, which no command of Python can undercut.

Exit code 0: the median is at most 0.3 s. 3: otherwise.
"""

import statistics
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from dlokit.errors import EXIT_OTHERWISE, ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from parts.command import check_json, count_in, figures_table, run_study, value_in, write_figures
from parts.stops.first_press import measured_pass, measured_press

BAR_S = 0.3
"""Limit on the processor time from the start of the process to the press [s], for the median."""
CPU, LONGEST = "processor time, median", "processor time, max"


@dataclass(frozen=True, kw_only=True)
class Args:
    """Start `dlokit stop` again and again, and measure its processor time up to the press."""

    times: int = 10
    """Number of starts of `dlokit stop`, and of `python -c pass`."""
    json: Path | None = None
    """Also write all figures to this file."""


def run(args: Args) -> int:
    """Measure and print."""
    if args.times < 1:
        raise ConfigError(f"--times is {args.times}; it must be 1 or greater.")
    check_json(args.json)
    console = Console()
    pairs = [(measured_pass(), measured_press()) for _ in range(args.times)]  # in turn: both meet the same load
    figures = [
        *_times("python -c pass", [pass_s for pass_s, _ in pairs]),
        *_times("dlokit stop, until the press", [press.cpu_s for _, press in pairs]),
    ]
    columns = {"n": count_in(CPU), "median": value_in(CPU, 1e3), "max": value_in(LONGEST, 1e3)}
    console.print(figures_table("processor time from the start of a process", "ms", figures, columns))
    modules = pairs[-1][1].modules
    console.print(f"\nimported before the press, {len(modules)} modules:\n{' '.join(modules)}", highlight=False)
    write_figures(args.json, "stop_press", figures, {"times": args.times}, console)
    return 0 if statistics.median(press.cpu_s for _, press in pairs) <= BAR_S else EXIT_OTHERWISE


def _times(case: str, times_s: list[float]) -> list[BenchFigure]:
    n = len(times_s)
    return [
        figure(case, "dlokit", CPU, without_interval(statistics.median(times_s), n), "s"),
        figure(case, "dlokit", LONGEST, without_interval(max(times_s), n), "s"),
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
