"""Whether hours of running cost memory, descriptors, threads or shared memory: a live system, task after task.

    python benchmarks/soak.py 2
    nice -n 19 python benchmarks/soak.py 8 --json soak.json

Starts a live system, brings the DLO from one shape to another again and again, lays it out by hand after a task that is
infeasible because the DLO crosses itself, and samples what all processes of the system use every 2.3 seconds, in a
process that does not count. Meanwhile a headless Chromium opens and closes the viewer's page, and a peer with the run's
key floods the bus: with messages that cannot be decoded, calls that are rejected, peers that come and go. After the
first part of the time, in which caches fill, it fits a line to each figure and prints its slope an hour with a 95 %
interval, from blocks of five minutes, or eighths of a short soak: neighbouring samples are not independent. A block's
figure is the sum of each process's minimum, because buffers for pictures vary by 20 MB between two samples and an open
page has its own descriptors and threads, while a leak also raises the minimum; for shared memory it is the mean. A
second table names the memory of each process.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Annotated, Any, TypeVar

import msgspec
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from scipy import stats

import dlokit
from dlokit.errors import ConfigError, DlokitError, MachineError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval
from dlokit.functional.cell import api as cell
from dlokit.types.flow import RunOutcome
from parts.command import check_json, run_study, write_figures
from parts.soak_samples import Sample

BLOCK_S = 300.0
SETTLES_S = 1800.0
"""Time at the beginning that does not count, or a third of a shorter soak [s]."""
MOST_INFEASIBLE = 3
"""The soak ends after this many infeasible tasks in a row, although the DLO is laid out after each."""
FAILED_S = 5.0
"""Wait after a task that did not run to its end [s]."""
PART_ENDS_S = 30.0
"""Longest wait for the end of the processes of the load and of the samples [s]."""
GOALS = ("S", "I")
UNITS = {"memory": "MB/h", "descriptors": "1/h", "threads": "1/h", "shared memory": "MB/h"}
OF_A_PROCESS = ("memory", "descriptors", "threads")
"""Figures that each process has of its own."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Run task after task for hours, and print how memory, descriptors, threads and shared memory grow."""

    hours: Annotated[float, tyro.conf.Positional] = 2.0
    """Duration [h]."""
    seed: int = 0
    """Seed of the system."""
    alone: bool = False
    """Without viewer, browser and flooding peer. The browser is what the tests of the viewer need: `make test`."""
    out: Path | None = None
    """Keep the folder of the run here."""
    json: Path | None = None
    """Also write every figure to this file, and each sample to NAME-samples.jsonl beside it."""


@dataclass
class Soak:
    """What the tasks and the load did."""

    tasks: int = 0
    converged: int = 0
    ends: Counter[str] = field(default_factory=Counter[str])
    """How the tasks ended, by outcome or by the reason of a failure."""
    recoveries: Counter[str] = field(default_factory=Counter[str])
    """How often the arm braked on its own and went on, by the robot's reason."""
    load_counts: dict[str, int] = field(default_factory=dict[str, int])
    """Number of pages, messages, calls and peers of the load."""
    ended_by: str = ""
    """Why it ended before its time."""

    def line(self, newest: Sample) -> str:
        """The tasks and the newest sample, for the terminal."""
        sums = {name: sum(getattr(use, name) for use in newest.processes) for name in OF_A_PROCESS}
        seen = ", ".join(f"{name} {value:.0f}" for name, value in (*sums.items(), ("shared memory", newest.shared_mb)))
        return f"{newest.time_s / 3600.0:.2f} h: {self.tasks} tasks, {self.converged} converged; {seen}"


def samples_of(file: Path) -> Generator[Sample]:
    """The samples of a file to which another process may be adding; an unfinished line is left out."""
    with file.open("rb") as lines:
        for line in lines:
            if line.endswith(b"\n"):
                yield msgspec.json.decode(line, type=Sample)


def of_processes(samples: Sequence[Sample], name: str) -> list[dict[int, float]]:
    """A figure of each process by its process id, for each sample."""
    return [{use.pid: getattr(use, name) for use in sample.processes} for sample in samples]


T = TypeVar("T")


def slope(
    times_s: Sequence[float], values: Sequence[T], of_block: Callable[[list[T]], float], from_s: float
) -> Interval:
    """Slope an hour of a figure from a time on, with its 95 % interval, from blocks: `of_block` is a block's figure."""
    kept = [(at_s, value) for at_s, value in zip(times_s, values, strict=True) if at_s >= from_s]
    block_s = min(BLOCK_S, (times_s[-1] - from_s) / 8.0) if kept else BLOCK_S
    blocks: dict[int, list[tuple[float, T]]] = {}
    for at_s, value in kept:
        blocks.setdefault(int((at_s - from_s) / block_s), []).append((at_s, value))
    # The last one may be short, and the minimum of a few samples is higher.
    most = max(map(len, blocks.values()), default=0)
    blocks = {number: block for number, block in blocks.items() if len(block) > most / 2}
    if len(blocks) < 3:
        return Interval(value=float("nan"), low=None, high=None, n=len(blocks))
    at_h = [float(np.mean([at_s for at_s, _ in block])) / 3600.0 for block in blocks.values()]
    figures = [of_block([value for _, value in block]) for block in blocks.values()]
    if len(set(figures)) == 1:  # the fit has no standard error then
        return Interval(value=0.0, low=0.0, high=0.0, n=len(blocks))
    fit: Any = stats.linregress(at_h, figures)
    value, half = float(fit.slope), float(stats.t.ppf(0.975, len(blocks) - 2) * fit.stderr)
    return Interval(value=value, low=value - half, high=value + half, n=len(blocks))


def _bounds(found: Interval) -> tuple[str, str]:
    return ("", "") if found.low is None or found.high is None else (f"{found.low:.2f}", f"{found.high:.2f}")


def mean(values: list[float]) -> float:
    """The figure of a block of shared memory: its mean."""
    return float(np.mean(values))


def sum_of_minima(samples: list[dict[int, float]]) -> float:
    """The figure of a block: the sum of the minimum of each process that is in every sample."""
    throughout = set(samples[0]).intersection(*samples)
    return sum(min(sample[pid] for sample in samples) for pid in throughout)


def run(args: Args) -> int:
    """Run, sample and print; exit code 0."""
    if not args.hours > 0.0:
        raise ConfigError(f"HOURS is {args.hours}; it must be above 0.")
    check_json(args.json)
    console, soak = Console(), Soak()
    with tempfile.TemporaryDirectory(prefix="dlokit-soak-") as folder:
        file = args.json.with_name(f"{args.json.stem}-samples.jsonl") if args.json else Path(folder) / "samples.jsonl"
        run_dir = (args.out or Path(folder) / "run").resolve()
        soak.ended_by = _soak(args, run_dir, soak, file.resolve(), console)
        samples = list(samples_of(file))
    if not samples:
        raise MachineError("the processes were not sampled: see the error above, and run it again.")
    _report(args, soak, samples, console)
    if not args.alone and not soak.load_counts:
        raise MachineError(
            "pages and flood did not run to the end, so the load was lighter: see the error above, and run it again."
        )
    return 0


def _report(args: Args, soak: Soak, samples: Sequence[Sample], console: Console) -> None:
    """Print the slopes, and write them."""
    from_s, times_s = min(SETTLES_S, args.hours * 3600.0 / 3.0), [sample.time_s for sample in samples]
    slopes = {name: slope(times_s, of_processes(samples, name), sum_of_minima, from_s) for name in OF_A_PROCESS}
    slopes["shared memory"] = slope(times_s, [sample.shared_mb for sample in samples], mean, from_s)
    settled = [sample for sample in samples if sample.time_s >= from_s]
    title = f"{soak.tasks} tasks, {soak.converged} converged, in {times_s[-1] / 3600.0:.2f} h"
    load = np.median([sample.load for sample in samples])
    caption = f"slopes from {from_s / 60.0:.0f} min on; median load of the machine {load:.1f}"
    console.print(_table(slopes, settled, title, caption))
    if settled:
        console.print(_memory_table(settled))
    for end, number in soak.ends.most_common():
        console.print(f"{number} tasks: {end}", markup=False)
    for reason, number in soak.recoveries.most_common():
        console.print(f"{number} recoveries of the arm: {reason}", markup=False)
    if soak.load_counts:
        counts = ", ".join(f"{number} {what}" for what, number in soak.load_counts.items())
        console.print(f"load: {counts}", markup=False)
    if soak.ended_by:
        console.print(f"ended early: {soak.ended_by}", markup=False)
    config = {"hours": args.hours, "seed": args.seed, "tasks": soak.tasks}
    write_figures(args.json, "soak", _figures(slopes), config, console)


def _soak(args: Args, folder: Path, soak: Soak, file: Path, console: Console) -> str:
    """Run tasks until the time is over; returns why it ended before."""
    began_s, said_s, infeasible = time.monotonic(), 0.0, 0
    with (
        dlokit.live("I", seed=args.seed, viewer=not args.alone, out=folder, progress=False) as system,
        nullcontext(0) if args.alone else _load(folder, system.page or "", soak) as load,
        _part("soak_samples", os.getpid(), load, file) as sampling,
    ):
        try:
            while time.monotonic() - began_s < args.hours * 3600.0:
                if sampling.poll() is not None:
                    return "the process that samples has ended"
                if time.monotonic() - began_s > said_s + BLOCK_S:
                    said_s += BLOCK_S
                    for newest in deque(samples_of(file), maxlen=1):
                        console.print(soak.line(newest), markup=False, highlight=False)
                try:
                    result = system.decision.shape_dlo(GOALS[soak.tasks % len(GOALS)])
                    soak.converged += result.outcome.is_success
                    soak.ends[result.outcome.value] += 1
                    soak.recoveries.update(recovery.reason for recovery in result.recoveries)
                    infeasible = infeasible + 1 if result.outcome is RunOutcome.INFEASIBLE else 0
                    if infeasible == MOST_INFEASIBLE:
                        return f"{infeasible} tasks in a row could not start: {result.reason}"
                    if infeasible:
                        system.call(cell.LAY)
                except DlokitError as error:
                    if system.fault is not None:
                        return str(error)
                    soak.ends[str(error)[:80]] += 1
                    time.sleep(FAILED_S)  # a failed task must not be asked for as fast as possible
                soak.tasks += 1
        except KeyboardInterrupt:
            return "Ctrl-C"
    return ""


@contextmanager
def _load(folder: Path, page: str, soak: Soak) -> Generator[int]:
    """Run the load, with its process id; its counts are known at the end."""
    said = folder / "soak-load.json"
    with said.open("w", encoding="utf-8") as out, _part("soak_load", folder, page, stdout=out) as load:
        yield load.pid
    with suppress(json.JSONDecodeError):
        soak.load_counts = json.loads(said.read_text(encoding="utf-8"))


@contextmanager
def _part(module: str, *arguments: object, stdout: IO[str] | None = None) -> Generator["subprocess.Popen[bytes]"]:
    """Run a part of the soak in a process of its own, which ends when its standard input is closed."""
    command = [sys.executable, "-m", f"parts.{module}", *map(str, arguments)]
    # In a session of its own: Ctrl-C ends the soak, and the soak ends its parts.
    folder = Path(__file__).parent
    part = subprocess.Popen(command, cwd=folder, stdin=subprocess.PIPE, stdout=stdout, start_new_session=True)
    try:
        yield part
    finally:
        try:
            part.communicate(timeout=PART_ENDS_S)
        except subprocess.TimeoutExpired:  # a browser of the load ends with it
            part.kill()
            part.communicate()


def _table(slopes: dict[str, Interval], settled: Sequence[Sample], title: str, caption: str) -> Table:
    table = Table(title=title, caption=caption)
    for heading in ("figure", "then", "end", "slope", "95 % low", "95 % high", "unit"):
        table.add_column(heading, justify="left" if heading in ("figure", "unit") else "right")
    sums = {name: [sum(uses.values()) for uses in of_processes(settled, name)] for name in OF_A_PROCESS}
    for name, found in slopes.items():
        values = sums.get(name, [sample.shared_mb for sample in settled])
        ends = (f"{values[0]:.1f}", f"{values[-1]:.1f}") if values else ("", "")
        table.add_row(name, *ends, f"{found.value:.2f}", *_bounds(found), UNITS[name])
    return table


def _memory_table(settled: Sequence[Sample]) -> Table:
    """Which process grows: the memory of those that ran throughout, those that grow most first."""
    memory, times_s = of_processes(settled, "memory"), [sample.time_s for sample in settled]
    names = {use.pid: use.name for sample in settled for use in sample.processes}
    table = Table(title="memory of each process")
    for heading in ("process", "least MB", "most MB", "slope MB/h", "95 % low", "95 % high"):
        table.add_column(heading, justify="left" if heading == "process" else "right")
    throughout = set(memory[0]).intersection(*memory)
    found = {pid: slope(times_s, [mb[pid] for mb in memory], min, times_s[0]) for pid in throughout}
    for pid, grows in sorted(found.items(), key=lambda each: -each[1].value):
        of_pid = [mb[pid] for mb in memory]
        table.add_row(names[pid], f"{min(of_pid):.1f}", f"{max(of_pid):.1f}", f"{grows.value:.2f}", *_bounds(grows))
    return table


def _figures(slopes: dict[str, Interval]) -> list[BenchFigure]:
    return [figure("soak", "dlokit", f"slope of {name}", found, UNITS[name]) for name, found in slopes.items()]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
