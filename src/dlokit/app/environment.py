"""The process of a command: its environment, which must be set before MuJoCo and NumPy are imported; its signals."""

import os
import platform
import signal
from types import FrameType

from dlokit.communication.timing.urgency import ONE_THREAD


def prepare_environment() -> None:
    """Render without a display, draw without one, and keep linear algebra on one thread."""
    os.environ["MPLBACKEND"] = "agg"  # a notebook sets its own for every command that a cell starts
    if platform.system() == "Linux":
        # The cell opens EGL itself when it takes its first picture. MuJoCo loads no OpenGL on import, whatever the
        # shell sets for other programs: without a driver that import would end `dlokit doctor` too.
        os.environ["MUJOCO_GL"] = "disable"
        os.environ["PYOPENGL_PLATFORM"] = "egl"
    keep_to_one_thread()


def keep_to_one_thread() -> None:
    """Keep linear algebra on one thread, in this process and in those that it starts; the user's values are kept."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)


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
        # The end of a login sends SIGTERM and SIGHUP, or SIGHUP twice; the run needs the time after the first to end.
        again = bool(came) and not (number == signal.SIGTERM and number in came)
        came.add(number)
        if not again:
            signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGTERM, end)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # nohup
        signal.signal(signal.SIGHUP, end)
