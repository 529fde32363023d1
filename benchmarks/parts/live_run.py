"""A live run in its own processes, started like `dlokit shape`, observed on its bus and exposed to faults."""

import asyncio
import os
import subprocess
import sys
import time
import uuid
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from dlokit.errors import InputError, ProcessFailure
from dlokit.system.processes.bus import JoinedBus, join_bus
from dlokit.system.processes.report import read_report
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.table import DECISION, TimeBase
from parts.logs import ArmLog, FlowLog

DLOKIT = (sys.executable, "-c", "from dlokit.app.main import main; main()")
"""The command line, independent of the installation folder."""
LABEL = "DLOKIT_BENCH_RUN"
"""Every process of a run has this environment variable, even after the death of its parent. Only the study reads it."""
STARTS_WITHIN_S = 420.0
TICKS_WITHIN_S = 30.0
LOOK_EVERY_S = 0.1
WORKER_MARK = "--multiprocessing-fork"


@dataclass
class StartedCommand:
    """A `dlokit` command whose processes can be distinguished from all others."""

    arguments: tuple[str, ...]
    output: Path
    """File that receives its output."""
    command: tuple[str, ...] = DLOKIT
    label: str = field(default_factory=lambda: uuid.uuid4().hex)

    def start(self) -> None:
        """Start the command."""
        with self.output.open("wb") as output:
            self._popen = subprocess.Popen(
                (*self.command, *self.arguments),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, LABEL: self.label},
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process id of its main process."""
        return self._popen.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""
        return self._popen.poll()

    async def ends_within(self, limit_s: float) -> bool:
        """Wait for its end; returns whether it ended."""
        end_s = time.monotonic() + limit_s
        while self.exit_code is None:
            if time.monotonic() > end_s:
                return False
            await asyncio.sleep(LOOK_EVERY_S)
        return True

    def alive(self) -> list[psutil.Process]:
        """All its processes that still exist, including itself, anywhere in the process tree."""
        return [process for process in psutil.process_iter() if _labelled(process, self.label)]

    async def remaining_processes(self, within_s: float) -> tuple[str, ...]:
        """The command lines of the processes that still exist `within_s` after its end."""
        end_s = time.monotonic() + within_s
        # A process that ends triggers no event here.
        while (left := self.alive()) and time.monotonic() < end_s:  # noqa: ASYNC110
            await asyncio.sleep(LOOK_EVERY_S)
        return tuple(" ".join(_command(process)) or f"process {process.pid}" for process in left)

    def kill(self) -> None:
        """Kill its remaining processes."""
        for process in self.alive():
            with suppress(psutil.Error):  # it has ended on its own
                process.kill()
        self._popen.wait()


@dataclass(frozen=True, kw_only=True)
class LiveRun:
    """A running run, with the logs of its messages."""

    program: StartedCommand
    folder: Path
    bus: JoinedBus
    arm: ArmLog
    flow: FlowLog

    def pid_of(self, process: str) -> int:
        """Id of a process of the table. Raises `ProcessFailure` when it does not run."""
        if process == DECISION.name:
            return self.program.pid
        report = read_report(self.folder)
        for row in () if report is None else report.processes:
            if row.name == process:
                return row.pid
        raise ProcessFailure(f"no_process: {process}", f"the run in {self.folder} has no such process")

    def worker_of(self, process: str) -> int:
        """Id of the worker that a process has started for heavy work. Raises `ProcessFailure` without one."""
        for child in psutil.Process(self.pid_of(process)).children():
            if WORKER_MARK in _command(child):
                return child.pid
        raise ProcessFailure(f"no_worker: {process}", f"the process {process} of {self.folder} has no worker")


@asynccontextmanager
async def live_run(program: StartedCommand, folder: Path) -> AsyncGenerator[LiveRun]:
    """Start a program that runs in `folder` and join its bus; remaining processes are killed at the end.

    Raises `ProcessFailure` when it does not start a task.
    """
    program.start()
    try:
        system = await _system_of(program, folder)
        async with join_bus(system.bus, TimeBase.CELL) as bus:
            flow, arm = FlowLog(bus.transport), ArmLog(bus.transport)
            await bus.first_tick(TICKS_WITHIN_S)
            yield LiveRun(program=program, folder=folder, bus=bus, arm=arm, flow=flow)
    finally:
        program.kill()


async def _system_of(program: StartedCommand, folder: Path) -> RunningSystem:
    end_s = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < end_s and program.exit_code is None:
        with suppress(InputError):
            return the_running_system(folder)
        await asyncio.sleep(LOOK_EVERY_S)
    raise ProcessFailure("not_started", f"nothing runs in {folder}; see {program.output}")


def _labelled(process: psutil.Process, label: str) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE and process.environ().get(LABEL) == label
    except psutil.Error:  # it has just ended, or belongs to another user
        return False


def _command(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []
