"""The faults that can be injected into a run; each class begins and ends one kind of fault."""

import asyncio
import json
import os
import resource
import signal
import time
from contextlib import suppress
from dataclasses import dataclass

import psutil

from dlokit.errors import ProcessFailure
from dlokit.functional.cell import api as cell
from dlokit.recording.channels import FILE_NAME
from dlokit.system.processes.running import the_running_system
from dlokit.system.table import DECISION
from dlokit.types.outcome import Succeeded
from parts.faults import forging_peer
from parts.faults.disturbance import Disturbance, disturb
from parts.live_run import LiveRun


class Injury:
    """A fault that can be injected; this one is the control, a run without a fault."""

    def unable(self) -> str:
        """The reason why this machine cannot inject it; empty if it can."""
        return ""

    async def inject(self, run: LiveRun) -> float | None:
        """Begin the fault; returns from when on the run feels it [s of the machine's clock], None: from the call on.

        Raises `ProcessFailure` when its target does not exist.
        """

    async def heal(self, run: LiveRun) -> None:
        """End the fault, if it can be reversed and has not ended."""


@dataclass
class Signalled(Injury):
    """A process of the table, or its worker, receives a signal: SIGKILL or SIGSTOP."""

    process: str
    number: signal.Signals
    worker: bool = False
    _victim: psutil.Process | None = None

    async def inject(self, run: LiveRun) -> None:
        """Send the signal."""
        self._victim = psutil.Process(run.worker_of(self.process) if self.worker else run.pid_of(self.process))
        self._victim.send_signal(self.number)

    async def heal(self, run: LiveRun) -> None:
        """Resume a process that was stopped and still exists."""
        if self.number is signal.SIGSTOP and self._victim is not None and self._victim.is_running():
            self._victim.send_signal(signal.SIGCONT)


@dataclass(frozen=True)
class AllFrozen(Injury):
    """All processes of the run are stopped together, as on a machine that is suspended, and go on together."""

    for_s: float

    async def inject(self, run: LiveRun) -> float:
        """Stop them, and let them go on; the run feels it from then on."""
        stopped = run.program.alive()
        for process in stopped:
            process.send_signal(signal.SIGSTOP)
        await asyncio.sleep(self.for_s)
        went_on_s = time.monotonic()  # before the first one goes on: an arm brakes within milliseconds
        for process in stopped:
            with suppress(psutil.NoSuchProcess):  # a worker that was ending
                process.send_signal(signal.SIGCONT)
        return went_on_s


@dataclass(frozen=True)
class SlippedGrasp(Injury):
    """The fingers open and close again without the system's knowledge, so that the DLO falls."""

    open_m: float = 0.03
    for_s: float = 0.3
    """Duration on the cell's clock [s]."""
    force_n: float = 20.0

    async def inject(self, run: LiveRun) -> None:
        """Let the cell do it, without the robot component."""
        slipped = await run.bus.transport.call(cell.SLIP, self.open_m, self.for_s, self.force_n)
        assert isinstance(slipped, Succeeded), slipped


@dataclass(frozen=True)
class ForgingPeer(Injury):
    """A peer without the run's key sends heartbeats, calls and leases in the commander's name, until it gives up."""

    of_another_user: bool = False

    def unable(self) -> str:
        """Only root may start a process of another user."""
        return "only root may start a process of another user" if self.of_another_user and os.geteuid() != 0 else ""

    async def inject(self, run: LiveRun) -> None:
        """Raises `ProcessFailure` if the peer reached anything."""
        system = the_running_system(run.folder)
        commander = run.bus.transport.alive(DECISION.name).server
        user = forging_peer.NOBODY if self.of_another_user else os.getuid()
        command = forging_peer.command(user, system.namespace, commander, system.bus.connect)
        peer = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        said, _ = await peer.communicate()
        if peer.returncode != 0 or json.loads(said) != forging_peer.REFUSED:
            raise ProcessFailure("forged", f"a peer without the key was not refused: {said.decode()}")


@dataclass(frozen=True)
class Disturbed(Injury):
    """All messages and calls of a run are delayed, or some do not arrive; the run must be started for it."""

    kind: Disturbance

    async def inject(self, run: LiveRun) -> None:
        """Begin."""
        disturb(run.folder.parent, self.kind)

    async def heal(self, run: LiveRun) -> None:
        """End."""
        disturb(run.folder.parent, Disturbance.NONE)


@dataclass
class FullDisk(Injury):
    """The recording cannot grow any more: the operating system limits its file size (RLIMIT_FSIZE, EFBIG).

    A full disk gives another error (ENOSPC); the recorder treats both in the same way. No special rights are needed.
    """

    _before: tuple[int, int] | None = None

    def unable(self) -> str:
        """Only Linux can limit another process."""
        return "" if hasattr(resource, "prlimit") else "this system cannot limit the files of another process"

    async def inject(self, run: LiveRun) -> None:
        """Set the limit to the current size of the recording."""
        size = os.stat(run.folder / FILE_NAME).st_size
        self._before = resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE, (size, self._before[1]))

    async def heal(self, run: LiveRun) -> None:
        """Remove the limit."""
        if self._before is not None and run.program.exit_code is None:
            resource.prlimit(run.program.pid, resource.RLIMIT_FSIZE, self._before)
