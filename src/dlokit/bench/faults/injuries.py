"""What is done to a run: each a small object that does harm, and ends it."""

import os
import resource
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import psutil

from dlokit.bench.faults.disturbance import Disturbance, disturb
from dlokit.bench.faults.live_run import LiveRun
from dlokit.functional.cell import api as cell
from dlokit.recording.channels import FILE_NAME
from dlokit.types.outcome import Succeeded

_LEASE_S = 10.0  # of fingers that a bench moves past their driver; nobody renews it


class Injury(Protocol):
    """Something that goes wrong."""

    def unable(self) -> str:
        """Why it cannot be done on this machine; empty where it can."""
        ...

    async def inject(self, run: LiveRun) -> None:
        """Do it. Raises `ProcessFailure` when there is nothing to do it to."""
        ...

    async def heal(self, run: LiveRun) -> None:
        """Let it be over, as far as it is not for good."""
        ...


class Nothing:
    """The control: a run that nothing happens to."""

    def unable(self) -> str:
        """Always possible."""
        return ""

    async def inject(self, run: LiveRun) -> None:
        """Nothing."""

    async def heal(self, run: LiveRun) -> None:
        """Nothing."""


@dataclass
class Signalled:
    """A process of the table, or the worker it has for heavy work, gets a signal: SIGKILL or SIGSTOP."""

    process: str
    number: signal.Signals
    worker: bool = False
    _victim: psutil.Process | None = None

    def unable(self) -> str:
        """One's own processes may always be signalled."""
        return ""

    async def inject(self, run: LiveRun) -> None:
        """Send it."""
        self._victim = psutil.Process(run.worker_of(self.process) if self.worker else run.pid_of(self.process))
        self._victim.send_signal(self.number)

    async def heal(self, run: LiveRun) -> None:
        """A process that was stopped and is still there goes on."""
        if self.number is signal.SIGSTOP and self._victim is not None and self._victim.is_running():
            self._victim.send_signal(signal.SIGCONT)


@dataclass(frozen=True)
class SlippedGrasp:
    """The fingers open behind the system's back and close again: the DLO falls out of them."""

    open_m: float = 0.03
    for_s: float = 0.3
    """On the cell's clock."""
    force_n: float = 20.0

    def unable(self) -> str:
        """The simulated cell can always be asked."""
        return ""

    async def inject(self, run: LiveRun) -> None:
        """Past the robot, over its driver's cable to the cell."""
        opened = await run.bus.transport.call(cell.GRIP, self.open_m, self.force_n, _LEASE_S)
        assert isinstance(opened, Succeeded), opened
        await run.bus.clock.sleep(self.for_s)
        await run.bus.transport.call(cell.GRIP, 0.0, self.force_n, _LEASE_S)

    async def heal(self, run: LiveRun) -> None:
        """It is over."""


@dataclass(frozen=True)
class Disturbed:
    """All messages and calls of a run come late, or feedback does not arrive; the run must be started for it."""

    kind: Disturbance

    def unable(self) -> str:
        """It is done in the run's own processes."""
        return ""

    async def inject(self, run: LiveRun) -> None:
        """Begin."""
        disturb(run.folder.parent, self.kind)

    async def heal(self, run: LiveRun) -> None:
        """End."""
        disturb(run.folder.parent, Disturbance.NONE)


@dataclass
class FullDisk:
    """The operating system takes no more of the recording: its file may not grow any more (RLIMIT_FSIZE, EFBIG).

    A full disk says so by another number (ENOSPC); the recorder treats both alike. No rights are needed for it.
    """

    _before: tuple[int, int] | None = None

    def unable(self) -> str:
        """Linux alone limits another process."""
        return "" if hasattr(resource, "prlimit") else "this system cannot limit the files of another process"

    async def inject(self, run: LiveRun) -> None:
        """From the size on that the recording has."""
        size = _size(run.folder / FILE_NAME)
        self._before = resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE, (size, self._before[1]))

    async def heal(self, run: LiveRun) -> None:
        """There is room again."""
        if self._before is not None and run.program.exit_code is None:
            resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE, self._before)


def _size(path: Path) -> int:
    return os.stat(path).st_size
