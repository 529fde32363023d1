"""One started process as seen by its supervisor: its specification, heartbeat, end, and the tail of its log."""

import asyncio
import math
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import msgspec

from dlokit.communication.timing.urgency import ONE_THREAD
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.table import TimeBase


class ChildSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The settings that differ between processes; each process reads its own as a line of JSON on standard input."""

    process: str
    components: tuple[str, ...]
    bus: ZenohConfig
    time_base: TimeBase
    config_file: str
    """Path of the run's configuration."""
    run_dir: str
    page_key: str
    """Access key of the viewer's page; not an argument, because process lists show arguments to all users."""
    beat_fd: int
    """Inherited pipe: `BEAT` repeatedly while it prepares its work and afterwards, and `READY` once in between."""
    outlives_s: float = 0.0
    """Time for which it continues after its standard input has ended [s]."""
    after: tuple[str, ...] = ()
    """Components that must be on the bus before this process reports that it is ready."""
    others_within_s: float = 60.0
    """Time limit for these components, and for the first tick of the cell's clock if it follows that clock [s]."""


READY = b"r"
BEAT = b"."

BEAT_PERIOD_S = 0.5
"""Heartbeat period, in wall time [s]."""


EXIT_NO_DEVICE = 4
"""Exit code: a device does not respond; the last line of the log names it and the remedy."""

_ALLOCATOR = {"MALLOC_ARENA_MAX": "2"}
"""Number of heaps of glibc's allocator, unless the user's environment sets it. The default is eight per processor:
memory that a thread frees stays in its heap, and a process has thirty threads. Other C libraries ignore it. A fixed
mmap threshold (`MALLOC_MMAP_THRESHOLD_`) would save more, but pictures and clouds then take a fifth longer."""

STOP_GRACE_S = 5.0
"""Time between the request to end and the kill [s]: the arm brakes, files are closed."""


TAIL_LINES = 12
TAIL_BYTES = 8192
POLL_S = 0.02
"""Period of checks whether a process has ended [s]."""


class LogFile:
    """The log of a process, opened once for all of its restarts."""

    def __init__(self, path: Path) -> None:
        """Create the file. Raises `OSError`."""
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self.handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644)

    def end(self) -> bytes:
        """The last bytes. Raises `OSError`."""
        size = os.fstat(self.handle).st_size
        return os.pread(self.handle, TAIL_BYTES, max(0, size - TAIL_BYTES))

    def close(self) -> None:
        """Close the file; its processes keep it."""
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1


class ChildProcess:
    """A process with two pipes: its standard input, whose end is the request to end, and one for its heartbeat.

    It leads its own process group: Ctrl-C reaches only the parent process, which stops its children in order; and the
    child's own children can be killed with it. A separate session would also achieve this, but Linux divides the
    processors among sessions, and on a busy machine the commander, whose heartbeats must arrive within the lease of
    its arm, got no larger fraction than other sessions.
    """

    def __init__(
        self,
        command: tuple[str, ...],
        spec: ChildSpec,
        log: "LogFile",
        kill_group: Callable[[int, int], None] = os.killpg,
    ) -> None:
        """Start `command`, which appends its output to `log`. Raises `OSError` when the start fails.

        `kill_group` sends a signal to a group of processes.
        """
        self._kill_group = kill_group
        self._loop = asyncio.get_running_loop()
        self.name = spec.process
        self._log = log
        self.ready = asyncio.Event()
        self.last_beat_s = self._loop.time()
        self._beats, beat_end = os.pipe()
        try:
            os.set_blocking(self._beats, False)
            self._popen = subprocess.Popen(
                (*command, spec.process),  # the name is shown in process lists
                stdin=subprocess.PIPE,
                stdout=log.handle,
                stderr=log.handle,
                pass_fds=(beat_end,),
                process_group=0,
                env={**_ALLOCATOR, **ONE_THREAD, **os.environ},
            )
        except BaseException:
            os.close(self._beats)
            raise
        finally:
            os.close(beat_end)
        self._loop.add_reader(self._beats, self._on_beat)
        self._tell(msgspec.json.encode(msgspec.structs.replace(spec, beat_fd=beat_end)) + b"\n")

    @property
    def pid(self) -> int:
        """Process id."""
        return self._popen.pid

    @property
    def log_file(self) -> Path:
        """The file of its output."""
        return self._log.path

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it. The rest of its group ends with it."""
        if self._popen.returncode is None and _has_ended(self._popen.pid):
            # Its process id, also the number of its group, may be reused once the process is reaped.
            self._signal(signal.SIGKILL)
            self._popen.wait()
        return self._popen.returncode

    def silent_s(self) -> float:
        """Time since its last heartbeat, in wall time [s]."""
        return self._loop.time() - self.last_beat_s

    def tail(self) -> str:
        """The last lines of its log; if the log cannot be read, one line with the cause."""
        try:
            lines = self._log.end().decode(errors="replace").splitlines()
        except OSError as error:
            return f"the log of {self.name} cannot be read: {error}"
        return "\n".join(lines[-TAIL_LINES:])

    def last_line(self) -> str:
        """The last line of its log."""
        return self.tail().rpartition("\n")[2]

    async def stop(self) -> None:
        """Request the end of the process, wait, kill it, and kill its remaining children."""
        if self.exit_code is None:
            self._signal(signal.SIGTERM)
            if not await self._ended_within(STOP_GRACE_S):
                self._signal(signal.SIGKILL)
                await self._ended_within(STOP_GRACE_S)
        self.release()

    def release(self) -> None:
        """Kill the remaining processes of its group, and close the pipes."""
        # Its workers are in its group; a frozen one would remain forever.
        self._signal(signal.SIGKILL)
        if self._beats >= 0:
            self._loop.remove_reader(self._beats)
            os.close(self._beats)
            self._beats = -1
        if self._popen.stdin is not None:
            try:
                self._popen.stdin.close()
            except BrokenPipeError:
                self._popen.stdin = None

    def reap(self) -> None:
        """Collect the exit code of a process that `release` has killed: another one takes its place."""
        self._popen.poll()

    def _tell(self, line: bytes) -> None:
        assert self._popen.stdin is not None
        try:
            self._popen.stdin.write(line)
            self._popen.stdin.flush()
        except BrokenPipeError:
            return  # it died immediately: see its exit code

    def _signal(self, number: signal.Signals) -> None:
        if self._popen.returncode is not None:
            return  # its group was killed when its end was noticed; the number may belong to another process now
        try:
            self._kill_group(self._popen.pid, number)
        except (ProcessLookupError, PermissionError):
            return  # the group is empty

    async def _ended_within(self, limit_s: float) -> bool:
        for _ in range(math.ceil(limit_s / POLL_S)):
            if self.exit_code is not None:
                return True
            await asyncio.sleep(POLL_S)
        return self.exit_code is not None

    def _on_beat(self) -> None:
        beats = os.read(self._beats, 4096)
        if not beats:  # it has closed the pipe because it is ending
            self._loop.remove_reader(self._beats)
            return
        self.last_beat_s = self._loop.time()
        if READY in beats:
            self.ready.set()


def _has_ended(pid: int) -> bool:
    """Whether a child process has ended; it is not reaped."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
