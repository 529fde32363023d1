"""Formats that annexes and other packages add to `dlokit export` by entry points `dlokit.exports`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from dlokit.communication.strategies import rows_from_packages

EXPORTS = "dlokit.exports"
"""Group of entry points; each names an `ExportFormat`."""

Progress = Callable[[Path, int, int], None]
"""Called with a recording, the number of its converted messages, and the number of all its messages."""


@dataclass(frozen=True, kw_only=True)
class ExportFormat:
    """One format; it is written into the folder `--out`, which it requires."""

    name: str
    """Value of `--to`."""
    doc: str
    """What it is, in one sentence for `--help`, without its name and the full stop."""
    check: Callable[[Sequence[Path]], None]
    """Raises `InputError` when the recordings cannot be exported; called before anything is written."""
    write: Callable[[Sequence[Path], Path, Progress], list[str]]
    """Writes recordings into an empty folder, and returns a line for each output. After an exception no output is half
    written."""


@cache
def added_formats(taken: tuple[str, ...]) -> dict[str, ExportFormat]:
    """The added formats by name; one whose name is taken is skipped with a warning."""
    return {form.name: form for form in rows_from_packages(EXPORTS, ExportFormat, taken)}
