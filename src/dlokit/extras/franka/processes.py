"""The processes of a connection to an arm: streaming, hand and guardian, which start and end together."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from dlokit.communication.timing.urgency import ONE_THREAD
from dlokit.description.arm.model import ArmModel
from dlokit.extras.franka.channel import Channel, Word
from dlokit.extras.franka.link import Protection

_PACKAGE = __name__.rpartition(".")[0]
FROZEN_S = 1.3
"""A process whose heartbeat is older than this is lost [s]: a read of the arm's state gives up after 1 s."""
_BUSY_S = 6.0
"""The same while the arm clears its errors [s], in one call of the library."""
_TEXTS = {
    "guardian": "the guardian of the streaming process ended",
    "stream": "the streaming process ended",
    "hand": "the gripper does not answer; is it switched on, and no other program connected to it?",
}


class DeviceProcesses:
    """Three child processes, outside the parent's process group: after Ctrl-C they still have time to brake."""

    def __init__(self, channel: Channel, path: Path) -> None:
        """They map the channel's file at `path`."""
        self._channel, self._path = channel, path
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._kills = 0

    def start(self, address: str, protection: Protection, arm: ArmModel, real_time: bool) -> None:
        """Start them; the guardian first."""
        channel = self._channel
        self._kills = channel[Word.KILLS]
        limits = arm.limits
        settings = {
            "address": address,
            "protection": {
                "torque_nm": protection.torque_nm,
                "force_n": protection.force_n,
                "load_kg": protection.load_kg,
                "load_at_m": protection.load_at_m,
            },
            "limits": {
                "velocity": limits.velocity_rad_s.tolist(),
                "acceleration": limits.acceleration_rad_s2.tolist(),
                "jerk": limits.jerk_rad_s3.tolist(),
            },
            "real_time": real_time,
            "arm": arm.name,
        }
        channel[Word.GUARD_BEAT_NS] = channel[Word.STREAM_BEAT_NS] = channel[Word.HAND_BEAT_NS] = 0
        channel[Word.STREAM_SILENCE_NS] = channel[Word.CLOSE] = 0
        self._start("guardian")
        self._start("stream", json.dumps(settings))
        channel[Word.STREAM_PID] = self._running["stream"].pid
        self._start("hand", address, arm.name)

    def _start(self, name: str, *arguments: str) -> None:
        self._running[name] = subprocess.Popen(
            (sys.executable, "-m", f"{_PACKAGE}.{name}", str(self._path), *arguments),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
            start_new_session=True,
        )

    def lost(self, now_ns: int) -> str:
        """Why the connection is lost; empty while all processes live. A frozen streaming process is killed."""
        if not self._running:
            return "the arm is not connected; call robot.recover"
        for name, process in self._running.items():
            if process.poll() is not None:
                return self._told(name)
        channel = self._channel
        allowed_s = FROZEN_S if channel[Word.RECOVERED_ID] == channel[Word.RECOVER_ID] else _BUSY_S
        for name, word in (
            ("guardian", Word.GUARD_BEAT_NS),
            ("stream", Word.STREAM_BEAT_NS),
            ("hand", Word.HAND_BEAT_NS),
        ):
            beat_ns = channel[word]
            if beat_ns and now_ns - beat_ns > allowed_s * 1e9:
                self._running[name].kill()
                return f"the process '{name}' of the arm was silent for {allowed_s:g} s and was killed"
        return ""

    def _told(self, name: str) -> str:
        if name != "stream":
            return _TEXTS[name]
        said = self._channel.read_text()
        if said:
            return said
        if self._channel[Word.KILLS] > self._kills:
            return "the streaming process hung in a motion, and the guardian killed it; the arm has stopped by itself"
        return f"{_TEXTS[name]} with exit code {self._running[name].returncode}; the arm has stopped by itself"

    def pids(self) -> dict[str, int]:
        """Process ids by name, of the processes that were started."""
        return {name: process.pid for name, process in self._running.items()}

    def end(self, grace_s: float) -> None:
        """End all processes, and kill those that have not ended after a time; blocks no longer than this time."""
        self._channel[Word.CLOSE] = 1
        deadline_s = time.monotonic() + grace_s
        for process in self._running.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(deadline_s - time.monotonic(), 0.0))
        for process in self._running.values():
            if process.poll() is None:
                process.kill()
                process.wait()
        self._channel[Word.STREAM_PID] = 0
        self._running.clear()


def is_alive(pid: int) -> bool:
    """Whether a process runs; an ended process that was not collected does not count."""
    try:
        os.kill(pid, 0)
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


def kill_stray(pid: int) -> None:
    """Kill the streaming process of an earlier driver, unless another process has reused its id."""
    with contextlib.suppress(OSError):
        command = Path(f"/proc/{pid}/cmdline").read_bytes()
        if f"{_PACKAGE}.stream".encode() in command:
            os.kill(pid, signal.SIGKILL)
