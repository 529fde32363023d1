"""The signals that end a command: Ctrl-C, SIGTERM, and the end of its terminal."""

import os
import signal
from types import FrameType


def handle_signals() -> None:
    """Let SIGTERM and the end of the terminal (SIGHUP), unless it is ignored as by nohup, act like Ctrl-C."""
    # A shell makes background jobs of a script ignore SIGINT, but Ctrl-C must still stop them.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    terminals = [stream for stream in range(3) if os.isatty(stream)]
    came: set[int] = set()

    def end(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            for stream in terminals:  # where the terminal has gone, printing a line would fail
                os.dup2(os.open(os.devnull, os.O_RDWR), stream)
        # Who ends a login sends SIGTERM and SIGHUP, or SIGHUP twice; a second interrupt would not let the run wind up.
        again = bool(came) and not (number == signal.SIGTERM and number in came)
        came.add(number)
        if not again:
            signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGTERM, end)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
        signal.signal(signal.SIGHUP, end)
