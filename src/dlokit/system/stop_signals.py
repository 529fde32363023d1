"""Which signal ends a run: it is noted on its way to the handler that ends the run."""

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

NAMES = {signal.SIGINT: "SIGINT (Ctrl-C)", signal.SIGTERM: "SIGTERM"}


@contextmanager
def signals_noted() -> Generator[Callable[[], str]]:
    """Note which of SIGINT and SIGTERM comes first meanwhile, and pass each on to the handler that was set before.

    Gives a function that names it; empty where none came. None is noted on another thread than the main one, which
    alone gets signals, nor one that has no handler in Python.
    """
    came: list[str] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(NAMES[signal.Signals(number)])
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
