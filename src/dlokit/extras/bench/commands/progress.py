"""What benches share: terminal output of many runs, one after the other or in parallel."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from rich.console import Console

from dlokit.app.console import progress_bar, say

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
    """Collect all `runs`; print a line as each ends, a progress bar on a terminal, and a table of all at the end.

    On Ctrl-C it prints the table of the finished runs and how to continue, and raises the interrupt again.
    """
    done: list[T] = []
    with progress_bar(console) as progress:
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
