"""What benches share: terminal output of many runs, one after the other or in parallel, and the file of figures."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from dlokit.app.commands import say
from dlokit.errors import InputError

T = TypeVar("T")


def check_figures_file(path: Path | None) -> None:
    """Raise `InputError` where the figures of `--json` could not be written, before hours of results are lost."""
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(f"--json {path}: folder {path.resolve().parent} does not exist; create it first.")


def followed(
    runs: Iterable[T],
    total: int,
    folder: Path,
    console: Console,
    *,
    what: str,
    line_of: Callable[[T], str],
    print_all: Callable[[list[T]], None],
) -> list[T]:
    """Collect all `runs`; print a line as each ends, a progress bar on a terminal, and a table of all at the end.

    On Ctrl-C it prints the table of the finished runs and how to continue, and raises the interrupt again.
    """
    done: list[T] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task(what, total=total)
        try:
            for run in runs:
                done.append(run)
                progress.advance(bar)
                line = f"{len(done)}/{total} {line_of(run)}"
                say(console, line)
        except KeyboardInterrupt:
            if done:
                print_all(done)
            say(console, f"{len(done)} of {total} runs are finished; the same command with --out {folder} continues.")
            raise
    print_all(done)
    return done
