"""One started process as its supervisor sees it: what it is told, its pulse, its end, and the tail of its log."""

import asyncio
import math
import os
import signal
import subprocess
from pathlib import Path

import msgspec

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.table import TimeBase


class ChildSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that differs from one process to another."""

    process: str
    components: tuple[str, ...]
    bus: ZenohConfig
    time_base: TimeBase
    config_file: str
    """Path of the run's configuration."""
    run_dir: str
    instances: dict[str, tuple[str, ...]] = {}
    """What there is more than one of, besides the first, by component."""
    page_key: str
    """Key of the viewer's page; it is given here because lists of processes show arguments to everybody."""
    beat_fd: int
    """Inherited pipe: `READY` once, then `BEAT` again and again."""
    outlives_s: float = 0.0
    """It goes on for so long when its standard input ends [s]."""
    after: tuple[str, ...] = ()
    """Components that must be on the bus before this process says that it is ready."""
    others_within_s: float = 60.0
    """It waits so long for them, and for the first tick of the cell's clock where it follows that [s]."""


READY = b"r"
BEAT = b"."

BEAT_PERIOD_S = 0.5
"""Heartbeat period, on the machine's clock."""


STOP_GRACE_S = 5.0
"""A process that is asked to end gets this long before it is killed: the arm brakes, files are closed."""


def encode_spec(spec: ChildSpec) -> bytes:
    """One line."""
    return msgspec.json.encode(spec) + b"\n"


def decode_spec(line: bytes) -> ChildSpec:
    """The spec in a line."""
    return msgspec.json.decode(line, type=ChildSpec)


TAIL_LINES = 12
TAIL_BYTES = 8192
POLL_S = 0.02
"""How often a process that is ending is asked whether it has."""


class ChildProcess:
    """A process with two pipes: its standard input, whose end tells it to end, and one for its heartbeat.

    It leads a process group of its own: Ctrl-C reaches only the process that started it, which stops the others
    in order; and what it has started itself can be swept up with it. A session of its own would do that too, but Linux
    shares the processors out among sessions, and on a busy machine the commander, who must be heard within the lease of
    its arm, got no more than any other.
    """

    def __init__(self, command: tuple[str, ...], spec: ChildSpec, log_file: Path) -> None:
        """Start `command`, which appends its output to `log_file`. Raises `OSError` when the machine does not."""
        self._loop = asyncio.get_running_loop()
        self.name = spec.process
        self.log_file = log_file
        self.ready = asyncio.Event()
        self.last_beat_s = self._loop.time()
        self._beats, beat_end = os.pipe()
        try:
            os.set_blocking(self._beats, False)
            log_file.parent.mkdir(parents=True, exist_ok=True)
            with log_file.open("ab") as log:
                self._popen = subprocess.Popen(
                    (*command, spec.process),  # the name is for people who list processes
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=log,
                    pass_fds=(beat_end,),
                    process_group=0,
                )
        except BaseException:
            os.close(self._beats)
            raise
        finally:
            os.close(beat_end)
        self._loop.add_reader(self._beats, self._on_beat)
        self._tell(encode_spec(msgspec.structs.replace(spec, beat_fd=beat_end)))

    @property
    def pid(self) -> int:
        """Process number."""
        return self._popen.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""
        return self._popen.poll()

    def silent_s(self) -> float:
        """Time since its last heartbeat on the machine's clock [s]."""
        return self._loop.time() - self.last_beat_s

    def tail(self) -> str:
        """The last lines of its log; where that cannot be read, one line that says why."""
        try:
            with self.log_file.open("rb") as log:
                log.seek(max(0, os.fstat(log.fileno()).st_size - TAIL_BYTES))
                lines = log.read().decode(errors="replace").splitlines()
        except OSError as error:
            return f"the log of {self.name} cannot be read: {error}"
        return "\n".join(lines[-TAIL_LINES:])

    def last_line(self) -> str:
        """The last line of its log."""
        return self.tail().rpartition("\n")[2]

    async def stop(self) -> None:
        """Ask it to end, wait, kill; and sweep up what it left behind."""
        if self._popen.poll() is None:
            self._signal(signal.SIGTERM)
            if not await self._ended_within(STOP_GRACE_S):
                self._signal(signal.SIGKILL)
                await self._ended_within(STOP_GRACE_S)
        self.release()

    def release(self) -> None:
        """Kill what is left of its group, and close the pipes."""
        # Its own workers are in its group; a frozen process among them would stay for ever.
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
        self._popen.poll()

    def _tell(self, line: bytes) -> None:
        assert self._popen.stdin is not None
        try:
            self._popen.stdin.write(line)
            self._popen.stdin.flush()
        except BrokenPipeError:
            return  # it died at once: its exit code says so

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.killpg(self._popen.pid, number)
        except (ProcessLookupError, PermissionError):
            return  # nobody is left

    async def _ended_within(self, limit_s: float) -> bool:
        for _ in range(math.ceil(limit_s / POLL_S)):
            if self._popen.poll() is not None:
                return True
            await asyncio.sleep(POLL_S)
        return self._popen.poll() is not None

    def _on_beat(self) -> None:
        beats = os.read(self._beats, 4096)
        if not beats:  # it has closed the pipe: it is ending
            self._loop.remove_reader(self._beats)
            return
        self.last_beat_s = self._loop.time()
        if READY in beats:
            self.ready.set()
