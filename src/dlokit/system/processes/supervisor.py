"""Starts the processes of a run, watches them, and stops all of them.

Time here is the machine's monotonic clock, independent of the cell's clock.
"""

import asyncio
import contextlib
import logging
import math
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from dlokit.communication.container import end_tasks, first_of
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import EXIT_BAD_INPUT, DlokitError, InputError, ProcessFailure
from dlokit.recording.disk import Disk
from dlokit.skills.viewer.serving.address import new_key
from dlokit.system.processes.child_process import EXIT_NO_DEVICE, ChildProcess, ChildSpec, LogFile
from dlokit.system.processes.report import (
    NAME,
    TOLD_EVERY_S,
    ProcessReport,
    ProcessState,
    SystemReport,
    log_file,
    write_report,
)
from dlokit.system.table import ProcessRow, Restart

T = TypeVar("T")

log = logging.getLogger(__name__)

WATCH_PERIOD_S = 0.1
PAUSED_S = 2.0
"""A watch that was interrupted for longer than this [s] does not count heartbeats of that time as missing."""
STARTED_WITHIN_S = 900.0
"""Longest start of a process that sends heartbeats meanwhile [s]."""

PROCESS = (sys.executable, "-m", "dlokit.system.processes.main")
"""The command of every started process."""


@dataclass(frozen=True, kw_only=True)
class Launch:
    """How the processes of a run are started."""

    namespace: str
    """Namespace of the run on the bus."""
    config_file: Path
    run_dir: Path
    """Folder of the run; logs are written to its `logs/`."""
    command: tuple[str, ...] = PROCESS
    """Command to run; it reads its `ChildSpec` from standard input."""
    page_key: str = field(default_factory=new_key, repr=False)
    """Access key of the viewer's page; a restarted viewer keeps it, so that open pages reconnect."""


@dataclass
class _Watched:
    row: ProcessRow
    child: ChildProcess
    started_s: list[float] = field(default_factory=list[float])
    restart_at_s: float | None = None
    """Time at which a dead process is restarted; None: it is not dead."""
    given_up: bool = False


class Supervisor:
    """Manages the processes of one run. Use as an async context manager, on the main thread's loop."""

    def __init__(
        self, rows: tuple[ProcessRow, ...], launch: Launch, bus: Callable[[str], ZenohConfig], disk: Disk | None = None
    ) -> None:
        """`bus` gives the configuration with which a process, given by its name, joins the bus."""
        self._disk = disk or Disk()
        self._logs: dict[str, LogFile] = {}
        self._rows = rows
        self._launch = launch
        self._bus = bus
        self._watched: dict[str, _Watched] = {}
        self._watching: asyncio.Task[None] | None = None
        self._stopping = False
        self._failed: asyncio.Future[None] | None = None

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        return {name: watched.child.pid for name, watched in self._watched.items()}

    async def __aenter__(self) -> "Supervisor":
        self._failed = asyncio.get_running_loop().create_future()
        try:
            await self._start_all()
        except BaseException:  # including Ctrl-C: no process may remain
            await self._stop_all()
            raise
        self._watching = asyncio.create_task(self._watch(), name="watch processes")
        self._watching.add_done_callback(self._watch_ended)
        return self

    async def __aexit__(self, *exc: object) -> None:
        self._stopping = True
        if self._watching is not None:
            await end_tasks(self._watching)
        await self._stop_all()
        if self._failed is not None and self._failed.done():
            self._failed.exception()  # retrieved, so that the loop does not complain

    async def wait_failed(self) -> NoReturn:
        """Never return, but raise when an essential process has failed permanently, or the supervision itself ends.

        `ProcessFailure` names the process (``supervisor_failed``: the supervision has ended); `InputError` names the
        part of the configuration or of the machine that a process could not work with.
        """
        assert self._failed is not None, "the supervisor is not started"
        await asyncio.shield(self._failed)
        raise AssertionError("it ends with an error only")

    async def guard(self, main: Coroutine[Any, Any, T]) -> T:
        """Result of `main`, unless a process dies first: then `main` is cancelled and the failure raised."""
        return await first_of(self.wait_failed(), main)

    async def _start_all(self) -> None:
        waves = start_waves(self._rows)
        # In parallel, because loading libraries takes most of the time; dependent processes wait on their own.
        for wave in waves:
            for row in wave:
                child = self._spawn(row)
                self._watched[row.name] = _Watched(row, child, [asyncio.get_running_loop().time()])
                log.info("%s started as process %d", child.name, child.pid)
        for wave in waves:
            for row in wave:
                await self._until_ready(self._watched[row.name])

    def _spawn(self, row: ProcessRow) -> ChildProcess:
        """Start a process. Raises `ProcessFailure` when the start fails or its log file cannot be opened."""
        spec = ChildSpec(
            process=row.name,
            components=row.components,
            bus=self._bus(row.name),
            time_base=row.time_base,
            config_file=str(self._launch.config_file),
            run_dir=str(self._launch.run_dir),
            page_key=self._launch.page_key,
            outlives_s=row.outlives_s,
            after=tuple(name for other in self._rows if other.name in row.after for name in other.components),
            beat_fd=-1,
        )
        path = log_file(self._launch.run_dir, row.name)
        try:
            # Opened once: a restart during a motion waits for no disk.
            log = self._logs.get(row.name) or self._logs.setdefault(row.name, LogFile(path))
            return ChildProcess(self._launch.command, spec, log)
        except OSError as error:
            detail = f"{error}; its log file is {path}. Free the missing resource, then start the run again."
            raise ProcessFailure(f"process_not_started: {row.name}", detail) from error

    async def _until_ready(self, watched: _Watched) -> None:
        child = watched.child
        while not child.ready.is_set():
            if child.exit_code is not None:
                raise _cause_of_death(child)
            if failure := _start_failure(watched, asyncio.get_running_loop().time()):
                raise failure
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(child.ready.wait(), WATCH_PERIOD_S)

    def report(self) -> SystemReport:
        """The state of every process."""
        return SystemReport(
            written_s=asyncio.get_running_loop().time(),
            processes=tuple(_report(watched) for watched in self._watched.values()),
        )

    async def _watch(self) -> None:
        now_s = asyncio.get_running_loop().time
        written_s, looked_s = -math.inf, now_s()
        while True:
            if now_s() - written_s >= TOLD_EVERY_S:
                written_s = now_s()
                self._disk.put(NAME, partial(write_report, self._launch.run_dir, self.report()))
            await asyncio.sleep(WATCH_PERIOD_S)
            if now_s() - looked_s > PAUSED_S:  # this process was frozen, perhaps with all other processes
                for watched in self._watched.values():
                    watched.child.last_beat_s = now_s()
            looked_s = now_s()
            for watched in self._watched.values():
                if not watched.given_up:
                    self._examine(watched, asyncio.get_running_loop().time())

    def _examine(self, watched: _Watched, now_s: float) -> None:
        row, child = watched.row, watched.child
        if watched.restart_at_s is not None:
            if now_s >= watched.restart_at_s:
                self._start_again(watched, now_s)
        elif child.exit_code is not None:
            self._handle_death(watched, now_s, _cause_of_death(child))
        elif child.ready.is_set() and child.silent_s() > row.silent_for_s:
            detail = f"no heartbeat for {child.silent_s():.0f} s; see {child.log_file}\n{child.tail()}"
            self._handle_death(watched, now_s, ProcessFailure(f"process_frozen: {row.name}", detail))
        elif not child.ready.is_set() and (failure := _start_failure(watched, now_s)):
            self._handle_death(watched, now_s, failure)

    def _start_again(self, watched: _Watched, now_s: float) -> None:
        watched.child.reap()
        watched.restart_at_s = None
        watched.started_s.append(now_s)
        try:
            watched.child = self._spawn(watched.row)
        except ProcessFailure as failure:
            self._settle(watched, now_s, failure)
        else:
            log.info("%s started as process %d", watched.child.name, watched.child.pid)

    def _handle_death(self, watched: _Watched, now_s: float, cause: DlokitError) -> None:
        watched.child.release()
        self._settle(watched, now_s, cause)

    def _settle(self, watched: _Watched, now_s: float, cause: DlokitError) -> None:
        """Decide whether a dead process is restarted; the decision is stored before it is logged."""
        if may_restart(watched.row.restart, watched.started_s, now_s):
            # The delay grows, so that a process which dies immediately is not restarted as fast as possible.
            watched.restart_at_s = now_s + watched.row.restart.wait_s * 2 ** recent_restarts(
                watched.row.restart, watched.started_s, now_s
            )
            log.warning("%s; the process is restarted", cause)
            return
        watched.given_up = True
        if watched.row.essential:
            self._fail(cause)
        log.error("%s", cause)

    def _fail(self, cause: DlokitError) -> None:
        """Raise the failure in `wait_failed`; only the first one counts."""
        if self._failed is not None and not self._failed.done():
            self._failed.set_exception(cause)

    def _watch_ended(self, watch: "asyncio.Task[None]") -> None:
        """Fail the run when the supervision ends early, because no death of a process would be noticed any more."""
        if self._stopping:
            return
        error = None if watch.cancelled() else watch.exception()
        why = "cancelled" if error is None else type(error).__name__
        failure = ProcessFailure(f"supervisor_failed: {why}", f"the processes are no longer watched: {error or why}")
        self._fail(failure)
        log.error("%s", failure, exc_info=error)

    async def _stop_all(self) -> None:
        ended = {name: asyncio.Event() for name in self._watched}

        async def stop(watched: _Watched) -> None:
            for other in self._watched.values():
                if watched.row.name in other.row.after:
                    await ended[other.row.name].wait()  # an arm is at rest before its cell ends
            await watched.child.stop()
            ended[watched.row.name].set()

        try:
            await asyncio.gather(*(stop(watched) for watched in self._watched.values()))
        finally:
            # Also when the stopping itself is cancelled: no process may remain.
            for watched in self._watched.values():
                watched.child.release()
            for log in self._logs.values():
                log.close()


def _report(watched: _Watched) -> ProcessReport:
    if watched.given_up:
        state = ProcessState.GONE
    elif watched.restart_at_s is not None:
        state = ProcessState.WAITING
    else:
        state = ProcessState.RUNNING if watched.child.ready.is_set() else ProcessState.STARTING
    return ProcessReport(
        name=watched.row.name,
        components=watched.row.components,
        pid=watched.child.pid,
        state=state,
        started_s=watched.started_s[-1],
        restarts=len(watched.started_s) - 1,
        beat_s=watched.child.last_beat_s,
    )


def start_waves(rows: tuple[ProcessRow, ...]) -> list[list[ProcessRow]]:
    """Groups of rows that may be started together, in start order.

    Raises `ProcessFailure` when processes depend on one another in a cycle.
    """
    names = {row.name for row in rows}
    waves: list[list[ProcessRow]] = []
    ready: set[str] = set()
    while ready != names:
        wave = [row for row in rows if row.name not in ready and names.intersection(row.after) <= ready]
        if not wave:
            raise ProcessFailure("start_order", f"{sorted(names - ready)} wait for one another; see the process table")
        waves.append(wave)
        ready.update(row.name for row in wave)
    return waves


def may_restart(policy: Restart, started_s: list[float], now_s: float) -> bool:
    """Whether a process with these start times may be restarted; the first start does not count."""
    return recent_restarts(policy, started_s, now_s) < policy.times


def recent_restarts(policy: Restart, started_s: list[float], now_s: float) -> int:
    """Number of restarts within the window, given the start times."""
    return sum(now_s - start <= policy.window_s for start in started_s[1:])


def start_failure(row: ProcessRow, silent_s: float, for_s: float) -> str:
    """Why to stop a process that has been starting for `for_s` [s], silent for `silent_s` [s]; empty: keep waiting.

    The first start on a machine compiles, which takes 25 s on a fast processor; heartbeats continue meanwhile.
    """
    if silent_s > row.ready_within_s:
        return f"no sign of life for {row.ready_within_s:g} s"
    return f"not ready within {STARTED_WITHIN_S:g} s" if for_s > STARTED_WITHIN_S else ""


def _start_failure(watched: _Watched, now_s: float) -> ProcessFailure | None:
    row, child = watched.row, watched.child
    why = start_failure(row, child.silent_s(), now_s - watched.started_s[-1])
    if not why:
        return None
    return ProcessFailure(f"process_not_ready: {row.name}", f"{why}; see {child.log_file}\n{child.tail()}")


def _cause_of_death(child: ChildProcess) -> DlokitError:
    code = child.exit_code
    if code == EXIT_BAD_INPUT:
        return InputError(child.last_line())
    if code == EXIT_NO_DEVICE:
        return ProcessFailure(f"process_died: {child.name}", child.last_line())
    how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
    detail = f"{child.name} ended with {how}; the end of {child.log_file}:\n{child.tail()}"
    return ProcessFailure(f"process_died: {child.name}", detail)
