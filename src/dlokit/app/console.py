"""Output of commands: unformatted lines, tables and progress bars."""

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


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
