"""What a person sees of many runs, one after the other or side by side."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

T = TypeVar("T")


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
    """All `runs`; a line each as it is done, a bar on a terminal, and at the end all of them once more, in a table.

    Ctrl-C prints the table of what is finished, says how to go on, and is raised.
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
                console.print(line, highlight=False, soft_wrap=True, markup=False)
        except KeyboardInterrupt:
            if done:
                print_all(done)
            console.print(
                f"{len(done)} of {total} runs are finished; the same command with --out {folder} goes on.",
                highlight=False,
                soft_wrap=True,
            )
            raise
    print_all(done)
    return done
