"""Whether hours of running cost memory, descriptors, threads or shared memory: a live system, task after task.

    python benchmarks/soak.py 2
    nice -n 19 python benchmarks/soak.py 8 --json soak.json

Starts a live system, brings the DLO from one shape to another again and again, lays it out by hand after a task that is
infeasible because the DLO crosses itself, and looks at all processes of the system every 2.3 seconds. Meanwhile a
headless Chromium opens and closes the viewer's page, and a peer with the run's key floods the bus: with messages that
cannot be decoded, calls that are rejected, peers that come and go. After the first part of the time, in which caches
fill, it fits a line to each figure and prints its slope an hour with a 95 % interval, from blocks of five minutes, or
eighths of a short soak: neighbouring looks are not independent. A block's figure is the sum of each process's minimum,
because buffers for pictures vary by 20 MB between two looks and an open page has its own descriptors and threads, while
a leak also raises the minimum; for shared memory it is the mean. A second table names the memory of each process.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from array import array
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import psutil
import tyro
from rich.console import Console
from rich.table import Table
from scipy import stats

import dlokit
from dlokit.benches.report import BenchFigure, figure
from dlokit.errors import ConfigError, DlokitError, MachineError
from dlokit.evaluation.statistics import Interval
from dlokit.functional.cell import api as cell
from dlokit.system.processes.supervisor import PROCESS
from dlokit.types.flow import RunOutcome
from parts.command import check_json, run_study, write_figures

LOOK_EVERY_S = 2.3
"""Often: with looks seven seconds apart, a worker's least memory in five minutes was 117 or 128 MB by chance. And no
divisor of the 30 s after which processes return freed memory: a block would have many looks soon after the returns, or
none."""
BLOCK_S = 300.0
SETTLES_S = 1800.0
"""Time at the beginning that does not count, or a third of a shorter soak [s]."""
MOST_INFEASIBLE = 3
"""The soak ends after this many infeasible tasks in a row, although the DLO is laid out after each."""
FAILED_S = 5.0
"""Wait after a task that did not run to its end [s]."""
LOAD_ENDS_S = 30.0
"""Longest wait for the end of the load's process [s]."""
GOALS = ("S", "I")
UNITS = {"memory": "MB/h", "descriptors": "1/h", "threads": "1/h", "shared memory": "MB/h"}
OF_A_PROCESS = ("memory", "descriptors", "threads")
"""Figures that each process has of its own."""
COLUMNS = ("time_s", "process", "pid", *OF_A_PROCESS)
"""Columns of the file of looks."""


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
    """Also write every figure to this file, and to NAME-looks.csv beside it what each look saw of each process."""


@dataclass
class Soak:
    """What was seen. What each process had is in a file: the memory of this script is measured as well."""

    looks: Path
    """A row for each look and process: its time [s], the process's name, process id, memory [MB], descriptors,
    threads."""
    times_s: "array[float]" = field(default_factory=lambda: array("d"))
    shared_mb: "array[float]" = field(default_factory=lambda: array("d"))
    """Shared memory of all processes together [MB], a look each."""
    loads: "array[float]" = field(default_factory=lambda: array("d"))
    """Load of the machine, a look each."""
    newest: list[tuple[int, float, int, int]] = field(default_factory=list[tuple[int, float, int, int]])
    """What each process had at the newest look."""
    names: dict[int, str] = field(default_factory=dict[int, str])
    """What each process is, by its process id."""
    tasks: int = 0
    converged: int = 0
    ends: Counter[str] = field(default_factory=Counter[str])
    """How the tasks ended, by outcome or by the reason of a failure."""
    load_pid: int = 0
    """Process id of the load; 0: none."""
    load_counts: dict[str, int] = field(default_factory=dict[str, int])
    """Number of pages, messages, calls and peers of the load."""

    def __post_init__(self) -> None:
        """Begin the file."""
        self.looks.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")

    def look(self, now_s: float) -> None:
        """Measure all processes of the system: this one and its children, without those of the load."""
        family = [psutil.Process(), *psutil.Process().children(recursive=True)]
        with suppress(psutil.Error):
            if self.load_pid:
                load = psutil.Process(self.load_pid)
                others = [load, *load.children(recursive=True)]
                family = [process for process in family if process not in others]
        self.newest = [one for process in family if (one := _measured(process)) is not None]
        for process in family:
            if process.pid not in self.names:
                self.names[process.pid] = _name_of(process)
        with self.looks.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows((f"{now_s:.1f}", self.names[pid], pid, *has) for pid, *has in self.newest)
        self.times_s.append(now_s)
        self.shared_mb.append(_shared_bytes(family) / 1e6)
        self.loads.append(os.getloadavg()[0])

    def of_processes(self, name: str) -> list[dict[int, float]]:
        """A figure of each process by its process id, a look each."""
        looks: dict[str, dict[int, float]] = {}
        with self.looks.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                looks.setdefault(row["time_s"], {})[int(row["pid"])] = float(row[name])
        return list(looks.values())

    def line(self) -> str:
        """The newest look, for the terminal."""
        sums = zip(OF_A_PROCESS, map(sum, list(zip(*self.newest, strict=True))[1:]), strict=True)
        newest = ", ".join(f"{name} {value:.0f}" for name, value in (*sums, ("shared memory", self.shared_mb[-1])))
        return f"{self.times_s[-1] / 3600.0:.2f} h: {self.tasks} tasks, {self.converged} converged; {newest}"


def _name_of(process: psutil.Process) -> str:
    if process.pid == os.getpid():
        return "decision, and this script"
    with suppress(psutil.Error):
        command = process.cmdline()
        if PROCESS[-1] in command:
            return command[-1]
    return f"worker {process.pid}"


def _measured(process: psutil.Process) -> tuple[int, float, int, int] | None:
    """Process id, memory [MB], descriptors, threads."""
    try:
        # Pages that processes share count once; without the right to know them, all of each process.
        return process.pid, process.memory_full_info().uss / 1e6, process.num_fds(), process.num_threads()
    except psutil.Error:
        return None


def _shared_bytes(family: Sequence[psutil.Process]) -> int:
    """Shared memory that any of these processes has mapped; what several have mapped counts once."""
    largest: dict[str, int] = {}
    for process in family:
        mapped: Counter[str] = Counter()
        with suppress(OSError):
            for line in Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8").splitlines():
                addresses, _, _, _, inode, *name = line.split(maxsplit=5)
                if name and name[0].startswith("/dev/shm/"):
                    begin, end = (int(one, 16) for one in addresses.split("-"))
                    mapped[inode] += end - begin
        for inode, size in mapped.items():
            largest[inode] = max(largest.get(inode, 0), size)
    return sum(largest.values())


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
    # The last one may be short, and the minimum of a few looks is higher.
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


def sum_of_minima(looks: list[dict[int, float]]) -> float:
    """The figure of a block: the sum of the minimum of each process that every look has measured."""
    throughout = set(looks[0]).intersection(*looks)
    return sum(min(look[pid] for look in looks) for pid in throughout)


def run(args: Args) -> int:
    """Run, look and print; exit code 0."""
    if not args.hours > 0.0:
        raise ConfigError(f"HOURS is {args.hours}; it must be above 0.")
    check_json(args.json)
    console = Console()
    with tempfile.TemporaryDirectory(prefix="dlokit-soak-") as folder:
        soak = Soak(args.json.with_name(f"{args.json.stem}-looks.csv") if args.json else Path(folder) / "looks.csv")
        ended_by = _soak(args, args.out or Path(folder) / "run", soak, console)
        _report(args, soak, ended_by, console)
    if not args.alone and not soak.load_counts:
        raise MachineError(
            "pages and flood did not run to the end, so the load was lighter: see the error above, and run it again."
        )
    return 0


def _report(args: Args, soak: Soak, ended_by: str, console: Console) -> None:
    """Print the slopes, and write them."""
    from_s = min(SETTLES_S, args.hours * 3600.0 / 3.0)
    slopes = {name: slope(soak.times_s, soak.of_processes(name), sum_of_minima, from_s) for name in OF_A_PROCESS}
    slopes["shared memory"] = slope(soak.times_s, soak.shared_mb, mean, from_s)
    console.print(_table(soak, slopes, from_s))
    if (memory := _memory_table(soak, from_s)).row_count:
        console.print(memory)
    for end, number in soak.ends.most_common():
        console.print(f"{number} tasks: {end}", markup=False)
    if soak.load_counts:
        counts = ", ".join(f"{number} {what}" for what, number in soak.load_counts.items())
        console.print(f"load: {counts}", markup=False)
    if ended_by:
        console.print(f"ended early: {ended_by}", markup=False)
    config = {"hours": args.hours, "seed": args.seed, "tasks": soak.tasks}
    write_figures(args.json, "soak", _figures(slopes), config, console)


def _soak(args: Args, folder: Path, soak: Soak, console: Console) -> str:
    """Run tasks until the time is over; returns why it ended before."""
    began_s, over, infeasible = time.monotonic(), threading.Event(), 0

    def looks() -> None:
        while not over.wait(LOOK_EVERY_S):
            soak.look(time.monotonic() - began_s)
            if len(soak.times_s) % round(BLOCK_S / LOOK_EVERY_S) == 0:
                console.print(soak.line(), markup=False, highlight=False)

    with (
        dlokit.live("I", seed=args.seed, viewer=not args.alone, out=folder, progress=False) as system,
        nullcontext() if args.alone else _load(folder, system.page or "", soak),
    ):
        watcher = threading.Thread(target=looks, daemon=True)
        watcher.start()
        try:
            while time.monotonic() - began_s < args.hours * 3600.0:
                try:
                    result = system.decision.shape_dlo(GOALS[soak.tasks % len(GOALS)])
                    soak.converged += result.outcome.is_success
                    soak.ends[result.outcome.value] += 1
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
        finally:
            over.set()
            watcher.join()
    return ""


@contextmanager
def _load(folder: Path, page: str, soak: Soak) -> Generator[None]:
    """Run the load in a process of its own; its counts are known at the end."""
    command = (sys.executable, str(Path(__file__).parent / "parts" / "soak_load.py"), str(folder), page)
    # In a session of its own: Ctrl-C ends the soak, and the soak ends its load.
    load = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
    soak.load_pid = load.pid
    try:
        yield
    finally:
        try:
            said, _ = load.communicate(timeout=LOAD_ENDS_S)
        except subprocess.TimeoutExpired:  # its browser ends with it
            load.kill()
            said, _ = load.communicate()
        with suppress(json.JSONDecodeError):
            soak.load_counts = json.loads(said)


def _table(soak: Soak, slopes: dict[str, Interval], from_s: float) -> Table:
    load = np.median(soak.loads) if soak.loads else float("nan")
    hours = soak.times_s[-1] / 3600.0 if soak.times_s else 0.0
    table = Table(
        title=f"{soak.tasks} tasks, {soak.converged} converged, in {hours:.2f} h",
        caption=f"slopes from {from_s / 60.0:.0f} min on; median load of the machine {load:.1f}",
    )
    for heading in ("figure", "then", "end", "slope", "95 % low", "95 % high", "unit"):
        table.add_column(heading, justify="left" if heading in ("figure", "unit") else "right")
    totals = {name: [sum(look.values()) for look in soak.of_processes(name)] for name in OF_A_PROCESS}
    for name, found in slopes.items():
        of_looks = totals.get(name, soak.shared_mb)
        values = [value for at_s, value in zip(soak.times_s, of_looks, strict=True) if at_s >= from_s]
        ends = (f"{values[0]:.1f}", f"{values[-1]:.1f}") if values else ("", "")
        table.add_row(name, *ends, f"{found.value:.2f}", *_bounds(found), UNITS[name])
    return table


def _memory_table(soak: Soak, from_s: float) -> Table:
    """Which process grows: the memory of those that ran throughout, those that grow most first."""
    since = [at_s >= from_s for at_s in soak.times_s]
    looks = [look for look, counts in zip(soak.of_processes("memory"), since, strict=True) if counts]
    times_s = [at_s for at_s, counts in zip(soak.times_s, since, strict=True) if counts]
    table = Table(title="memory of each process")
    for heading in ("process", "least MB", "most MB", "slope MB/h", "95 % low", "95 % high"):
        table.add_column(heading, justify="left" if heading == "process" else "right")
    throughout = set(looks[0]).intersection(*looks) if looks else set[int]()
    found = {pid: slope(times_s, [look[pid] for look in looks], min, from_s) for pid in throughout}
    for pid, grows in sorted(found.items(), key=lambda each: -each[1].value):
        mb = [look[pid] for look in looks]
        table.add_row(soak.names[pid], f"{min(mb):.1f}", f"{max(mb):.1f}", f"{grows.value:.2f}", *_bounds(grows))
    return table


def _figures(slopes: dict[str, Interval]) -> list[BenchFigure]:
    return [figure("soak", "dlokit", f"slope of {name}", found, UNITS[name]) for name, found in slopes.items()]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
