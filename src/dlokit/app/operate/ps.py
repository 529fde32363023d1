"""`dlokit ps`: list the processes of the running systems, their state and their resource usage."""

import contextlib
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import psutil
import tyro
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dlokit.app.commands import CliCommand
from dlokit.errors import InputError
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import files_of
from dlokit.recording.writer import LARGEST_BYTES
from dlokit.system.processes.report import (
    LARGEST_LOG_BYTES,
    ProcessReport,
    ProcessState,
    SystemReport,
    read_report,
)
from dlokit.system.processes.running import RunningSystem, running_systems, the_running_system
from dlokit.system.table import DECISION

MEASURED_S = 0.5
"""Duration over which processor usage is measured [s]."""
STALE_S = 5.0
"""A supervisor that has not written a report for this long is shown as silent [s]."""

_STYLES = {
    ProcessState.RUNNING: "green",
    ProcessState.STARTING: "yellow",
    ProcessState.WAITING: "yellow",
    ProcessState.GONE: "bold red",
}


@dataclass(frozen=True, kw_only=True)
class PsArgs:
    """List the processes of your running systems: state, restarts, heartbeat, processor and memory.

    `beat s` is the time since the last heartbeat of a process, `fds` the number of files and sockets that it and its
    workers have open, `thr` that of their threads. A system that stops its processes, after its task or a Ctrl-C, is
    `ending`.
    """

    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Only the system of this run's folder."""
    watch: bool = False
    """Repeat until Ctrl-C."""


@dataclass(frozen=True, kw_only=True)
class Use:
    """Resource usage of a process and its workers."""

    cores: float
    memory_bytes: int
    descriptors: int = 0
    threads: int = 0


def run(args: PsArgs) -> int:
    """Print the table once or repeatedly; exit code 0, or 2 when no system runs."""
    console = Console()
    if not args.watch:
        console.print(_tables(_systems(args.run)))
        return 0
    with Live(console=console, refresh_per_second=4) as live:
        while True:
            live.update(_tables(_systems(args.run)))


def _systems(folder: Path | None) -> list[RunningSystem]:
    systems = running_systems() if folder is None else [the_running_system(folder)]
    if not systems:
        raise InputError("you have no running system: start one, e.g. dlokit shape --runtime live.")
    return systems


def _tables(systems: Sequence[RunningSystem]) -> Group:
    reports = [(system, read_report(Path(system.folder))) for system in systems]
    pids = {system.pid for system in systems}
    pids |= {process.pid for _, report in reports if report is not None for process in report.processes}
    used, now_s = measure(pids, MEASURED_S), time.monotonic()
    return Group(*(process_table(system, report, used, now_s) for system, report in reports))


def process_table(system: RunningSystem, report: SystemReport | None, used: Mapping[int, Use], now_s: float) -> Table:
    """The processes of one system, the decision process first; `now_s` is on the machine's monotonic clock."""
    # A supervisor that stops its processes watches them no more.
    silent_s = 0.0 if report is None or system.ending else now_s - report.written_s
    silent = f"[red]the supervisor has written no report for {silent_s:.0f} s[/]\n" if silent_s > STALE_S else ""
    caption = silent + files_text(Path(system.folder))
    # Without lines between the columns the table fits into a terminal of 80 columns.
    table = Table(title=system.folder, title_justify="left", caption=caption, box=None, padding=(0, 1, 0, 0))
    for heading in ("process", "components", "pid", "state", "up s", "restarts", "beat s", "cores", "MB", "fds", "thr"):
        table.add_column(heading, justify="left" if heading in ("process", "components", "state") else "right")
    up_s = time.time() - system.began_s
    state = Text("ending", style="yellow") if system.ending else Text("running", style="green")
    own = (DECISION.name, ", ".join(DECISION.components), str(system.pid), state)
    table.add_row(*own, f"{up_s:.0f}", "", "", *_used(used.get(system.pid)))
    for process in () if report is None else report.processes:
        state = Text(process.state.value, style=_STYLES[process.state])
        if system.ending:
            state = Text("ending", style="yellow") if process.pid in used else Text("ended")
        table.add_row(*_cells(process, state, now_s), *_used(used.get(process.pid)))
    return table


def files_text(folder: Path) -> str:
    """The size of a run's files, and their limits."""
    recording = [_size(path) for path in files_of(folder / FILE_NAME)]
    logs = [_size(path) for path in folder.glob("logs/*.log*")]
    return (
        f"recording {sum(recording) / 1e6:.0f} MB in {len(recording)} files (at most {LARGEST_BYTES / 1e9:.0f} GB), "
        f"logs {sum(logs) / 1e6:.1f} MB (at most {2 * LARGEST_LOG_BYTES / 1e6:.0f} each)"
    )


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _cells(process: ProcessReport, state: Text, now_s: float) -> tuple[str | Text, ...]:
    return (
        process.name,
        ", ".join(process.components),
        str(process.pid),
        state,
        f"{now_s - process.started_s:.0f}",
        str(process.restarts),
        f"{now_s - process.beat_s:.1f}",
    )


def _used(use: Use | None) -> tuple[str, ...]:
    if use is None:
        return ("", "", "", "")
    return (f"{use.cores:.2f}", f"{use.memory_bytes / 1e6:.0f}", str(use.descriptors), str(use.threads))


def measure(pids: Iterable[int], duration_s: float) -> dict[int, Use]:
    """Measure the resource usage of processes and their workers over `duration_s`; dead processes are omitted."""
    families = {pid: family for pid in pids if (family := _family(pid))}
    before = {pid: _total(family, _busy_s) for pid, family in families.items()}
    time.sleep(duration_s)
    return {
        pid: Use(
            cores=max(_total(family, _busy_s) - before[pid], 0.0) / duration_s,
            memory_bytes=int(_total(family, lambda process: process.memory_info().rss)),
            descriptors=int(_total(family, psutil.Process.num_fds)),
            threads=int(_total(family, psutil.Process.num_threads)),
        )
        for pid, family in families.items()
    }


def _family(pid: int) -> list[psutil.Process]:
    """A process and its workers; children with their own process group are separate rows of the table."""
    try:
        process = psutil.Process(pid)
        return [process, *(child for child in process.children(recursive=True) if _group(child) == _group(process))]
    except psutil.NoSuchProcess:
        return []


def _group(process: psutil.Process) -> int:
    try:
        return os.getpgid(process.pid)
    except ProcessLookupError:
        return -1


def _total(family: Iterable[psutil.Process], of: Callable[[psutil.Process], float]) -> float:
    """The sum over processes; ended and unreadable ones are omitted."""
    total = 0.0
    for process in family:
        with contextlib.suppress(psutil.Error):
            total += of(process)
    return total


def _busy_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


COMMAND = CliCommand(PsArgs, run)
