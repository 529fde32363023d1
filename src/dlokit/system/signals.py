"""The signals that end a run: the first one ends it in order; only a person who insists ends it at once."""

import os
import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

from dlokit.errors import EXIT_INTERRUPTED

NAMES = {signal.SIGINT: "SIGINT (Ctrl-C)", signal.SIGTERM: "SIGTERM", signal.SIGHUP: "SIGHUP (terminal closed)"}

OF_TERMINAL = (signal.SIGINT, signal.SIGHUP)
"""Signals that a terminal sends to all processes of a command: its first process ends the rest."""


ENDS_WITHIN_S = 60.0
"""Longest orderly end of a run [s]. A busy machine needs a fifth of it; each wait for a process or a disk that does not
answer is 10 s."""
_READ_S = 1.0
"""Time that a person has to read what the next Ctrl-C costs [s]: a key that is held down repeats at once."""


def leave_now(text: str) -> None:
    """Print a line, and end this process without any clean-up; from any thread, also within a signal's handler.

    The processes of a live system end on their own when their first one has ended, and its arms brake.
    """
    try:
        shown = "\x1b[?25h" if os.isatty(2) else ""  # a table that is drawn again and again hides the cursor
        os.write(2, f"{shown}\n{text}\n".encode())
    finally:
        os._exit(EXIT_INTERRUPTED)


def call_after(seconds: float, function: Callable[[], object]) -> None:
    """Call a function on another thread after some time, if this process still runs then."""
    timer = threading.Timer(seconds, function)
    timer.daemon = True
    timer.start()


class LastResort:
    """What ends a program whose run does not end in order: the time limit, or a person who presses Ctrl-C again."""

    def __init__(
        self,
        say: Callable[[str], object],
        *,
        leave: Callable[[str], object] = leave_now,
        after: Callable[[float, Callable[[], object]], object] = call_after,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`say` prints a line; `leave` ends the program; `after` calls a function after some seconds."""
        self._say, self._leave, self._after, self._now_s = say, leave, after, now_s
        self._said_s: float | None = None

    def begin(self) -> str:
        """Begin the time limit, and return it as a clause."""
        self._after(ENDS_WITHIN_S, lambda: self._leave(f"the run did not end within {ENDS_WITHIN_S:g} s: {_COST}"))
        return f"at most {ENDS_WITHIN_S:g} s"

    def press(self) -> None:
        """Say at the first Ctrl-C of an ending run what another one costs; end the program at that one."""
        if self._said_s is None:
            try:
                self._say(f"The run is ending. Ctrl-C again ends the program at once: {_COST}")
            except (Exception, SystemExit):  # its stream was just being written to, or has gone: the next one says it
                return
            self._said_s = self._now_s()
        elif self._now_s() - self._said_s >= _READ_S:
            self._leave(f"ended at once: {_COST}")


_COST = (
    "arms that still move brake on their own; files that are not written yet (result.json, report.html) are missing; "
    "the recording is readable up to its last second."
)


@contextmanager
def terminal_signals_blocked() -> Generator[None]:
    """Keep a terminal's signals from processes started while the context is open; on any thread."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, OF_TERMINAL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def signals_noted(
    tell: Callable[[str], object] = lambda name: None, again: Callable[[], object] = lambda: None
) -> Generator[Callable[[], str]]:
    """Note which of SIGINT, SIGTERM and SIGHUP arrives first and pass it on; the run is interrupted only once.

    SIGTERM and SIGHUP reach their handlers each time, and the SIGINT that these raise is passed on once. An interrupt
    while the arm brakes and files are written would lose the files, and a second Ctrl-C is easily pressed.

    `tell` is called with the name of the first, `again` at each later interrupt, both within the signal's handler: the
    loop of the run may be computing for seconds. Yields a function that returns it, empty if none arrived. Signals are
    noted only on the main thread, which alone receives them, and only those with a handler in Python.
    """
    came: list[str] = []
    interrupts: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(NAMES[signal.Signals(number)])
        if len(came) == 1:
            tell(came[0])
        if number == signal.SIGINT:
            interrupts.append(number)
            if len(interrupts) > 1:
                again()
                return
        handlers[signal.Signals(number)](number, frame)

    handlers: dict[signal.Signals, Callable[[int, FrameType | None], object]] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: handler for number in NAMES if callable(handler := signal.getsignal(number))}
    for number in handlers:
        signal.signal(number, note)
    try:
        yield lambda: came[0] if came else ""
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_answered(again: Callable[[], object] = lambda: None) -> Generator[None]:
    """Only call `again` at an interrupt, e.g. while the last files of a run are written; on the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, lambda number, frame: again())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
