"""Functions that run an event loop of their own, called where a loop may run already, as in a notebook."""

import asyncio
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from io import StringIO
from typing import TextIO, TypeVar

from rich.console import Console

T = TypeVar("T")


def outside_any_loop(function: Callable[[], T], cancel: Callable[[], object]) -> T:
    """Call `function`; on another thread where an event loop runs on this one.

    Ctrl-C then calls `cancel`, which must make the function return soon; its result is returned.
    """
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return function()
    with ThreadPoolExecutor(1, thread_name_prefix="dlokit") as pool:
        future = pool.submit(function)
        try:
            return future.result()
        except KeyboardInterrupt:
            cancel()
            return future.result()


class OneLine(StringIO):
    """A stream that shows the last line of what is written to it in place of the one before."""

    def __init__(self, out: TextIO) -> None:
        """Show it on `out`, which takes a carriage return, as terminals and notebooks do."""
        super().__init__()
        self._out, self._width = out, 0

    def write(self, text: str) -> int:
        """Show the last line of the text."""
        if lines := text.strip().splitlines():
            self._out.write("\r" + lines[-1].ljust(self._width))
            self._out.flush()
            self._width = len(lines[-1])
        return len(text)


def progress_console(progress: bool) -> Console:
    """The console of a call; what it prints in a notebook is one line, which changes."""
    if not Console().is_jupyter:
        return Console(quiet=not progress)
    # Kernels set FORCE_COLOR, which would make it a terminal.
    plain = OneLine(sys.stdout)
    return Console(file=plain, quiet=not progress, force_jupyter=False, force_terminal=False, no_color=True, width=160)
