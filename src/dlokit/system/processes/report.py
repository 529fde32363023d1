"""What the supervisor knows of its processes, in a file of the run's folder: any shell may read it, whatever hangs."""

import enum
import logging
from pathlib import Path

import msgspec
import psutil

NAME = "processes.json"
TOLD_EVERY_S = 1.0

log = logging.getLogger(__name__)


class ProcessState(enum.Enum):
    """How a process stands."""

    STARTING = "starting"
    RUNNING = "running"
    WAITING = "waiting to start again"
    GONE = "gone"
    """Dead for good: it was started again too often, or may not be."""


class ProcessReport(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a running system."""

    name: str
    components: tuple[str, ...]
    pid: int
    state: ProcessState
    started_s: float
    """When it was started last, on the machine's monotonic clock [s]."""
    restarts: int
    """How often it was started again."""
    beat_s: float
    """When its event loop gave its last heartbeat, on the same clock [s]."""


class SystemReport(msgspec.Struct, frozen=True, kw_only=True):
    """All processes that a supervisor has started."""

    written_s: float
    """When this was written, on the machine's monotonic clock [s]."""
    processes: tuple[ProcessReport, ...]


def write_report(run_dir: Path, report: SystemReport) -> None:
    """Replace the file; a disk that is full stops nobody."""
    part = run_dir / f"{NAME}.part"
    try:
        part.write_bytes(msgspec.json.encode(report))
        part.replace(run_dir / NAME)
    except OSError as error:
        log.warning("the report on the processes cannot be written: %s", error)


def unended_processes(run_dir: Path) -> list[str]:
    """The processes of a run that have not ended, by name: those of a killed run end by themselves within seconds."""
    report = read_report(run_dir)
    return [] if report is None else [process.name for process in report.processes if _runs(process)]


def _runs(process: ProcessReport) -> bool:
    try:
        found = psutil.Process(process.pid)
        # Numbers are used again; the name is the last word of the command.
        return found.status() != psutil.STATUS_ZOMBIE and found.cmdline()[-1:] == [process.name]
    except psutil.Error:
        return False


def read_report(run_dir: Path) -> SystemReport | None:
    """What was written last; None where nothing was, e.g. while the system starts."""
    try:
        return msgspec.json.decode((run_dir / NAME).read_bytes(), type=SystemReport)
    except (OSError, msgspec.DecodeError):
        return None
