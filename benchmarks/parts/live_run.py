"""A live run in its own processes, started like `dlokit shape`, observed on its bus and exposed to faults."""

import asyncio
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.communication.wire import codec
from dlokit.errors import ProcessFailure
from dlokit.system.processes.bus import JoinedBus, join_bus
from dlokit.system.processes.report import read_report
from dlokit.system.processes.running import RunningSystem, running_systems
from dlokit.system.table import DECISION, TimeBase
from dlokit.types.flow import FlowStatus
from parts.stops.logs import ArmLog

MENDING = frozenset({"restore", "recover"})
"""Steps in which the flow waits for a lost component, or recovers an arm that has braked."""


class FlowLog:
    """Every step that the flow has entered, with the time at which the message arrived."""

    def __init__(self, transport: Transport) -> None:
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self.boxes: list[tuple[float, FlowStatus]] = []
        transport.tap(topics.FLOW, self._hear)

    @property
    def step(self) -> str:
        """The current step of the flow; empty before the first."""
        return self.boxes[-1][1].step if self.boxes else ""

    @property
    def ended(self) -> bool:
        """Whether the flow has reached one of its ends."""
        return bool(self.boxes) and self.boxes[-1][1].outcome is not None

    async def begun(self) -> None:
        """Return when the flow is in its first step."""
        await self._until(lambda: bool(self.boxes))

    async def comes_to(self, steps: frozenset[str], times: int) -> bool:
        """Wait until the flow enters one of the steps for the `times`-th time; False when it ended earlier."""

        def there() -> bool:
            return self.ended or (self.step in steps and self._visits(steps) >= times)

        await self._until(there)
        return not self.ended

    async def end(self) -> None:
        """Return when the flow has ended."""
        await self._until(lambda: self.ended)

    def _visits(self, steps: frozenset[str]) -> int:
        return sum(status.step in steps for _, status in self.boxes)

    async def _until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._changed.clear()
            await self._changed.wait()

    def _hear(self, data: bytes) -> None:
        self.boxes.append((time.monotonic(), codec.decode(data, FlowStatus)))
        self._loop.call_soon_threadsafe(self._changed.set)


def recovery_time_s(boxes: list[tuple[float, str]], struck_s: float) -> float:
    """Time from a fault until the flow has left its last recovery step [s]; 0 if it had none.

    `boxes` are the times [s] on the machine's clock at which the flow entered each step. If the flow ended in a
    recovery step, or was cut off there, it has not recovered: inf.
    """
    after = [(at_s, step) for at_s, step in boxes if at_s >= struck_s]
    mending = [index for index, (_, step) in enumerate(after) if step in MENDING]
    if not mending:
        return 0.0
    last = mending[-1] + 1
    return after[last][0] - struck_s if last < len(after) else float("inf")


DLOKIT = (sys.executable, "-c", "from dlokit.app.main import main; main()")
"""The command line, independent of the installation folder."""
LABEL = "DLOKIT_BENCH_RUN"
"""Every process of a run has this environment variable, even after the death of its parent. Only the bench reads it."""
STARTS_WITHIN_S = 420.0
TICKS_WITHIN_S = 30.0
LOOK_EVERY_S = 0.1
PROCESS_MODULE = "dlokit.system.processes.main"
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
        return tuple(_line(process) for process in left)

    def kill(self) -> None:
        """Kill its remaining processes."""
        for process in self.alive():
            _kill(process)
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
        for child in self.program.alive():
            line = _command(child)
            if PROCESS_MODULE in line and line[-1] == process:
                return child.pid
        raise ProcessFailure(f"no_process: {process}", f"the run in {self.folder} has no such process")

    def worker_of(self, process: str) -> int:
        """Id of the worker that a process has started for heavy work. Raises `ProcessFailure` without one."""
        for child in psutil.Process(self.pid_of(process)).children():
            if WORKER_MARK in _command(child):
                return child.pid
        raise ProcessFailure(f"no_worker: {process}", f"the process {process} of {self.folder} has no worker")

    def pids(self) -> Iterator[int]:
        """The ids of all its processes."""
        return (process.pid for process in self.program.alive())

    def restarts(self) -> Mapping[str, int]:
        """Number of restarts by process name, from the supervisor's latest report."""
        report = read_report(self.folder)
        return {} if report is None else {row.name: row.restarts for row in report.processes if row.restarts}


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
        if (system := _running_in(folder)) is not None:
            return system
        await asyncio.sleep(LOOK_EVERY_S)
    raise ProcessFailure("not_started", f"nothing runs in {folder}; see {program.output}")


def _running_in(folder: Path) -> RunningSystem | None:
    return next((system for system in running_systems() if system.folder == str(folder.resolve())), None)


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


def _line(process: psutil.Process) -> str:
    return " ".join(_command(process)) or f"process {process.pid}"


def _kill(process: psutil.Process) -> None:
    try:
        process.send_signal(signal.SIGKILL)
    except psutil.Error:
        return  # it has ended on its own
