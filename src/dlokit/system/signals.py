"""The signals that end a run: the first one ends it; later ones, while the run shuts down, have no effect."""

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

NAMES = {signal.SIGINT: "SIGINT (Ctrl-C)", signal.SIGTERM: "SIGTERM", signal.SIGHUP: "SIGHUP (terminal closed)"}

OF_TERMINAL = (signal.SIGINT, signal.SIGHUP)
"""Signals that a terminal sends to all processes of a command: its first process ends the rest."""


@contextmanager
def terminal_signals_blocked() -> Generator[None]:
    """Keep a terminal's signals from processes started while the context is open; on any thread."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, OF_TERMINAL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def signals_noted(tell: Callable[[str], object] = lambda name: None) -> Generator[Callable[[], str]]:
    """Note which of SIGINT, SIGTERM and SIGHUP arrives first and pass it on; the run is interrupted only once.

    SIGTERM and SIGHUP reach their handlers each time, and the SIGINT that these raise is passed on once. An interrupt
    while the arm brakes and files are written would lose the files, and a second Ctrl-C is easily pressed.

    `tell` is called with the name of the first. Yields a function that returns it, empty if none arrived. Signals are
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
def interrupts_ignored() -> Generator[None]:
    """Ignore interrupts from now on, e.g. while the last files of a run are written; on the main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
