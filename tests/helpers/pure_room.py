"""What a test of the pure rooms may not do, and what no test may leave behind.

A pure test starts no process, opens no socket or zenoh session, does not sleep in real time and writes only below its
temporary folders. The operations are refused where Python does them, and noted as well, because the code under test may
catch the error.
"""

import _posixsubprocess
import os
import selectors
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

LONGEST_SLEEP_S = 0.02
"""A thread may give way to another for as long [s]."""
THREAD_ENDS_S = 10.0
"""Time for a thread that was told to end [s]: that of a hang."""

_SEAMS = {
    "process": "call the function in this process (`dlokit.app.commands.execute`), or inject what starts it",
    "socket": "pass the request to its handler, or inject the connection",
    "zenoh session": "use a `MemoryTransport`",
    "sleep": "run it in `virtual_time.run`, or inject the clock and the time limit",
    "file": "write below `tmp_path`",
}
_PROCESSES = ("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system")
_SOCKETS = ("socket.bind", "socket.connect")
_NEW_FOLDERS = ("os.mkdir", "tempfile.mkdtemp")
_SELECTORS = (selectors.EpollSelector, selectors.PollSelector, selectors.SelectSelector)

Wrapper = Callable[[Callable[..., Any]], Callable[..., Any]]


class ImpureTest(Exception):
    """Raised where a test of the pure rooms does what only tests of the live and long rooms may do."""


class PureRoom:
    """Watches this process between `enter` and `leave`."""

    def __init__(self) -> None:
        self._noted: list[str] | None = None
        self.writable: tuple[Path, ...] = ()
        self._roots: tuple[str, ...] = ()
        self._threads: set[threading.Thread] = set()
        sys.addaudithook(self._audit)
        _replace(_posixsubprocess, "fork_exec", self._refusing("process", "starts a process"))
        _replace(time, "sleep", self._refusing_sleep)
        for selector in _SELECTORS:
            _replace(selector, "select", self._refusing_wait)
        _replace(threading.Condition, "wait", self._refusing_wait)

    def enter(self, writable: Sequence[Path]) -> None:
        """From now on, refuse impure operations, and files outside of `writable`."""
        self.writable = tuple(writable)
        self._roots = tuple(os.path.realpath(path) for path in (*writable, "/dev"))
        self._threads = set(threading.enumerate())
        self._refuse_zenoh()
        self._noted = []

    def leave(self, thread_ends_s: float = THREAD_ENDS_S) -> None:
        """End the watch. Raises `ImpureTest` for operations whose error was caught, and for threads that go on."""
        noted, self._noted = self._noted or [], None
        noted += [f"a test leaves the thread {thread.name!r}: end it" for thread in self._left_threads(thread_ends_s)]
        if noted:
            raise ImpureTest("; ".join(dict.fromkeys(noted)))

    def forget(self) -> list[str]:
        """What was refused since `enter`, for the test of this class, whose subject that is."""
        noted, self._noted = self._noted or [], []
        return noted

    def _left_threads(self, ends_s: float) -> list[threading.Thread]:
        new = [thread for thread in threading.enumerate() if thread not in self._threads]
        for thread in new:
            if not thread.daemon:
                thread.join(ends_s)
        return [thread for thread in new if thread.is_alive() and not thread.daemon]

    def _refuse(self, kind: str, what: str, *, late: bool = False) -> None:
        if self._noted is None or threading.current_thread() in self._threads - {threading.main_thread()}:
            return  # what a thread of an earlier test does is not this test's
        sentence = f"a test outside the live rooms {what}: {_SEAMS[kind]}, or mark it `live`"
        self._noted.append(sentence)
        if not late:
            raise ImpureTest(sentence)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self._noted is None:
            return
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, str | bytes) and flags & (os.O_WRONLY | os.O_RDWR):
                self._refuse_outside(path)
        elif event in _NEW_FOLDERS:
            self._refuse_outside(arguments[0])
        elif event in _PROCESSES:
            self._refuse("process", f"starts a process ({event})")
        elif event in _SOCKETS:
            self._refuse("socket", f"opens a socket ({arguments[1]!r})")

    def _refuse_outside(self, path: str | bytes) -> None:
        real = os.path.realpath(os.fsdecode(path))
        if not real.startswith(self._roots) and "__pycache__" not in real:
            self._refuse("file", f"writes {real}")

    def _refuse_zenoh(self) -> None:
        zenoh = sys.modules.get("zenoh")
        if zenoh is not None and not hasattr(zenoh.open, "refusing"):
            _replace(zenoh, "open", self._refusing("zenoh session", "opens a zenoh session"))
            zenoh.open.refusing = True

    def _refusing(self, kind: str, what: str) -> Wrapper:
        def wrapped(original: Callable[..., Any]) -> Callable[..., Any]:
            def call(*arguments: Any, **named: Any) -> Any:
                self._refuse(kind, what)
                return original(*arguments, **named)

            return call

        return wrapped

    def _refusing_sleep(self, original: Callable[[float], None]) -> Callable[[float], None]:
        def sleep(duration_s: float, /) -> None:
            if duration_s > LONGEST_SLEEP_S:
                self._refuse("sleep", f"sleeps for {duration_s:g} s")
            original(duration_s)

        return sleep

    def _refusing_wait(self, original: Callable[..., Any]) -> Callable[..., Any]:
        """A wait whose time ran out is a sleep; one that something ended is not. Threads that poll delay no test."""

        def wait(waiting: Any, timeout: float | None = None) -> Any:
            ended = original(waiting, timeout)
            slept = timeout is not None and timeout > LONGEST_SLEEP_S and not ended
            if slept and threading.current_thread() is threading.main_thread():
                self._refuse("sleep", f"waits for {timeout:.3g} s until the time is over", late=True)
            return ended

        return wait


def _replace(owner: Any, name: str, wrapped: Wrapper) -> None:
    setattr(owner, name, wrapped(getattr(owner, name)))
