"""Output of commands: unformatted lines, tables, progress bars, and the preparations that users wait for."""

import sys
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from io import StringIO
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from dlokit.system.config import RunConfig


def say(console: Console, text: str) -> None:
    """Print lines unchanged: brackets in names are not markup, and long lines do not wrap."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def console_of_width(least: int) -> Console:
    """A console whose tables do not wrap, for a terminal of any or unknown width."""
    return Console(width=max(Console().width, least))


def progress_bar(console: Console) -> Progress:
    """A progress bar with a count; it is shown only on a terminal, and removed at its end."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


class OneLine(StringIO):
    """A stream that shows only the last line that was written to it; each line replaces the previous one."""

    def __init__(self, out: TextIO) -> None:
        """Show the line on `out`, which must support carriage returns, as terminals and notebooks do."""
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
    """The console of a call of the library; in a notebook it shows one line, which changes."""
    if not Console().is_jupyter:
        return Console(quiet=not progress)
    # Notebook kernels set FORCE_COLOR, from which rich would conclude that the output is a terminal.
    plain = OneLine(sys.stdout)
    return Console(file=plain, quiet=not progress, force_jupyter=False, force_terminal=False, no_color=True, width=160)


def prepare(console: Console, config: "RunConfig") -> None:
    """Compile and load the observer and the planner of a run, and show the progress."""
    from dlokit.skills.observer.kernels import load_kernels
    from dlokit.skills.planning.config import load

    with compile_progress(console, "the observer (1 of 2)"):
        load_kernels((config.observer.strategy,))
    with compile_progress(console, "the planner (2 of 2)"):
        load(config.planning.strategy)


@contextmanager
def compile_progress(console: Console, what: str) -> Generator[None]:
    """Show that `what` is being prepared and, while Numba compiles, how many functions are finished."""
    from numba.core import event

    begun = done = 0
    status = console.status(f"preparing {what}")
    with status if console.is_terminal else nullcontext():  # its thread redraws a line, which only a terminal shows

        class CompilationCounter(event.Listener):
            def on_start(self, event: Any) -> None:
                nonlocal begun
                begun += 1
                if begun == 1:  # compiling a kernel also compiles the functions that it calls
                    say(console, f"compiling the kernels of {what}: once per installation of dlokit, about 20 s")

            def on_end(self, event: Any) -> None:
                nonlocal done
                done += 1
                status.update(f"compiling the kernels of {what}: {done} functions finished")

        with event.install_listener("numba:compile", CompilationCounter()):
            yield
    if done:
        say(console, f"compiled {done} functions of {what}")
