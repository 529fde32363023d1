"""What commands print: lines as they are, and the bar of what is done many times."""

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


def say(console: Console, text: str) -> None:
    """Print lines as they are: brackets in names are no markup, and a long line is not broken."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def console_of_width(least: int) -> Console:
    """A console whose tables do not wrap, however narrow or unknown the terminal is."""
    return Console(width=max(Console().width, least))


def progress_bar(console: Console) -> Progress:
    """A bar that counts what is done; it is shown on a terminal alone, and leaves nothing there."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
