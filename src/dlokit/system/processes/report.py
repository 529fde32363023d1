"""The supervisor's report on its processes, in a file of the run's folder that any shell can read."""

import enum
import os
import shutil
from pathlib import Path

import msgspec
import psutil

NAME = "processes.json"
TOLD_EVERY_S = 1.0


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


LARGEST_LOG_BYTES = 10_000_000
"""Size at which the log of a process begins again [bytes]; the previous part is kept as `<process>.log.1`."""


def write_report(run_dir: Path, report: SystemReport) -> None:
    """Replace the report file, and bound the logs. Raises `OSError`."""
    part = run_dir / f"{NAME}.part"
    part.write_bytes(msgspec.json.encode(report))  # not synced: it means nothing after the machine has stopped
    part.replace(run_dir / NAME)
    for process in report.processes:
        bound_log(log_file(run_dir, process.name))


def log_file(run_dir: Path, process: str) -> Path:
    """The log of a process."""
    return run_dir / "logs" / f"{process}.log"


def bound_log(log: Path, largest_bytes: int = LARGEST_LOG_BYTES) -> None:
    """Move the content of a log that has grown too large aside; its process keeps writing to the same file.

    The process appends, so that its next line is the first of the emptied file.
    """
    if log.exists() and log.stat().st_size > largest_bytes:
        shutil.copyfile(log, log.with_name(f"{log.name}.1"))
        os.truncate(log, 0)


def unended_processes(run_dir: Path) -> list[str]:
    """Names of the processes of a run that have not ended; after a kill of the run, they end within seconds."""
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
    """The latest report; None if it is missing, e.g. while the system starts."""
    try:
        return msgspec.json.decode((run_dir / NAME).read_bytes(), type=SystemReport)
    except (OSError, msgspec.DecodeError):
        return None
