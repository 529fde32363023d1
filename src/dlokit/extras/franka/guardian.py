"""The guardian: it kills a streaming process that is silent during a motion. Standard library only.

A streaming process can hang so that its own code cannot help: another thread holds the interpreter's lock, a debugger
or a signal has stopped it, its memory is swapped out. A thread of the library then keeps sending the last set-point.
When the process is dead, the arm detects this within a few cycles, and stops. The guardian only reads and writes words
of the shared memory, so that it cannot hang. It ends when the driver's process is gone.

    python -m dlokit.extras.franka.guardian FILE
"""

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from dlokit.extras.franka.channel import Channel, Word

PERIOD_S = 0.005
_LATE_S = 0.02
"""A guardian that wakes later than planned by this [s] checks once more: all processes may have been paused."""
ORPHAN_S = 2.0
"""After the driver's death the streaming process gets this long to brake and end [s], before it is killed."""
PRIORITY = 50
"""Real-time priority, above the streaming process's, where the system allows one."""


class Guardian:
    """Checks the heartbeats, one check per call."""

    def __init__(self, channel: Channel, kill: Callable[[int], bool], parent_alive: Callable[[], bool]) -> None:
        """`kill` ends a process by its id, and returns whether it existed."""
        self._channel, self._kill, self._parent_alive = channel, kill, parent_alive
        self._orphan_since_ns = 0
        self._last_ns = 0
        self._late = False

    def look(self, now_ns: int) -> bool:
        """Check once, at a time of the monotonic clock; False when no process is left to guard."""
        channel = self._channel
        # Only once: on a machine so busy that the guardian always wakes late, it must still act.
        self._late = not self._late and bool(self._last_ns) and now_ns - self._last_ns > (PERIOD_S + _LATE_S) * 1e9
        self._last_ns = now_ns
        channel[Word.GUARD_BEAT_NS] = now_ns
        pid = channel[Word.STREAM_PID]
        allowed_ns = channel[Word.STREAM_SILENCE_NS]
        if pid and allowed_ns and not self._late and now_ns - channel[Word.STREAM_BEAT_NS] > allowed_ns:
            self._end(pid)
        if self._parent_alive():
            return not channel[Word.CLOSE] or channel[Word.STREAM_SILENCE_NS] != 0
        self._orphan_since_ns = self._orphan_since_ns or now_ns
        if now_ns - self._orphan_since_ns < ORPHAN_S * 1e9:
            return True
        if pid:
            self._end(pid)
        return False

    def _end(self, pid: int) -> None:
        channel = self._channel
        if self._kill(pid):
            channel[Word.KILLS] += 1
        channel[Word.STREAM_PID] = 0
        channel[Word.STREAM_SILENCE_NS] = 0


class ProcessKiller:
    """Kills processes that it has seen alive, but no process that has reused one of their ids."""

    def __init__(self) -> None:
        self._pid = self._handle = 0

    def see(self, pid: int) -> None:
        """Keep a handle of the process, as soon as it exists."""
        if pid != self._pid:
            if self._handle:
                os.close(self._handle)
            self._pid, self._handle = pid, 0
            with contextlib.suppress(OSError):  # it has ended already
                self._handle = os.pidfd_open(pid) if pid else 0

    def __call__(self, pid: int) -> bool:
        """Kill it; returns whether it was alive."""
        self.see(pid)
        if not self._handle:
            return False
        with contextlib.suppress(OSError):
            signal.pidfd_send_signal(self._handle, signal.SIGKILL)
            return True
        return False


def main(arguments: list[str]) -> int:
    """Guard until the driver closes or dies."""
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
    parent = os.getppid()
    killer = ProcessKiller()
    with Channel(Path(arguments[0])) as channel:
        guardian = Guardian(channel, killer, lambda: os.getppid() == parent)
        while guardian.look(time.monotonic_ns()):
            killer.see(channel[Word.STREAM_PID])
            time.sleep(PERIOD_S)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
