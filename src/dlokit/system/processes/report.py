"""The supervisor's report on its processes, in a file of the run's folder that any shell can read."""

import enum
import logging
from pathlib import Path

import msgspec
import psutil

NAME = "processes.json"
TOLD_EVERY_S = 1.0

log = logging.getLogger(__name__)


class ProcessState(enum.Enum):
    """State of a process."""

    STARTING = "starting"
    RUNNING = "running"
    WAITING = "waiting to start again"
    GONE = "gone"
    """Dead and not restarted: the restart limit was reached, or its policy allows none."""


class ProcessReport(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a running system."""

    name: str
    components: tuple[str, ...]
    pid: int
    state: ProcessState
    started_s: float
    """Time of the last start, on the machine's monotonic clock [s]."""
    restarts: int
    """Number of restarts."""
    beat_s: float
    """Time of the last heartbeat of its event loop, on the same clock [s]."""


class SystemReport(msgspec.Struct, frozen=True, kw_only=True):
    """All processes started by a supervisor."""

    written_s: float
    """Time of this report, on the machine's monotonic clock [s]."""
    processes: tuple[ProcessReport, ...]


def write_report(run_dir: Path, report: SystemReport) -> None:
    """Replace the report file; a full disk is logged and otherwise ignored."""
    part = run_dir / f"{NAME}.part"
    try:
        part.write_bytes(msgspec.json.encode(report))
        part.replace(run_dir / NAME)
    except OSError as error:
        log.warning("the report on the processes cannot be written: %s", error)


def unended_processes(run_dir: Path) -> list[str]:
    """Names of the processes of a run that have not ended; those of a killed run end on their own within seconds."""
    report = read_report(run_dir)
    return [] if report is None else [process.name for process in report.processes if _runs(process)]


def _runs(process: ProcessReport) -> bool:
    try:
        found = psutil.Process(process.pid)
        # Process ids are reused, so the name, the last word of the command, is compared too.
        return found.status() != psutil.STATUS_ZOMBIE and found.cmdline()[-1:] == [process.name]
    except psutil.Error:
        return False


def read_report(run_dir: Path) -> SystemReport | None:
    """The latest report; None if there is none, e.g. while the system starts."""
    try:
        return msgspec.json.decode((run_dir / NAME).read_bytes(), type=SystemReport)
    except (OSError, msgspec.DecodeError):
        return None
