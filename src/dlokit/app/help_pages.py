"""The help of a command, page by page: what people use first, then a page for each group of settings.

A run has some three hundred settings. tyro lists all of them; whoever asks for help the first time needs a dozen.
"""

import contextlib
import io
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rich.console import Console
from rich.table import Table

from dlokit.errors import ConfigError

T = TypeVar("T")

HELP = ("-h", "--help")
ALL = "all"
_FEW_BOXES = 4
"""Help of so many boxes is shown whole."""
_COLORS = re.compile(r"\x1b\[[0-9;]*m")
_TOP = re.compile(r"^╭─ (?P<title>\S+(?: \S+)*) ─+╮$")
_FLAG = re.compile(r"^│ (?P<flag>-\S+)")


@dataclass(frozen=True)
class _Box:
    """A box of tyro's, line by line."""

    title: str
    """Of the settings in it, `cell.dlo`; empty: the command's own."""
    about: tuple[str, ...]
    """What stands above its flags, with the borders."""
    flags: tuple[tuple[str, tuple[str, ...]], ...]
    """Each with its lines."""
    bottom: str

    @property
    def group(self) -> str:
        return self.title.partition(".")[0]

    @property
    def summary(self) -> str:
        """What the settings are for, in one line."""
        lines = (_COLORS.sub("", line).strip("│ ") for line in self.about[1:])
        return " ".join(line for line in lines if line.strip("─"))

    def with_flags(self, wanted: Callable[[str], bool]) -> "_Box":
        return _Box(self.title, self.about, tuple(each for each in self.flags if wanted(each[0])), self.bottom)

    def lines(self) -> Iterator[str]:
        yield from self.about
        for _, lines in self.flags:
            yield from lines
        yield self.bottom


class _Page(io.StringIO):
    """Takes what is printed, with the colors and lines that the terminal would have."""

    @property
    def encoding(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]  # one that is only read
        return getattr(sys.__stdout__, "encoding", None) or "ascii"

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def paged(words: str, arguments: Sequence[str], parse: Callable[[list[str]], T]) -> T:
    """What `parse` makes of the arguments of the command `words`; where they ask for help, the page that they name.

    Raises `ConfigError` for a page that there is none of; `SystemExit` after a page, and where `parse` does.
    """
    rest, page = _asked(arguments)
    if page is None:
        return parse(rest)
    caught = _Page()
    try:
        with contextlib.redirect_stdout(caught):
            return parse(rest)
    except SystemExit:
        if caught.getvalue():  # else what was typed beside --help was wrong, and has been told
            _print(caught.getvalue(), words, page)
        raise


def _asked(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The arguments without the page that they ask for; its name, empty for the first; None when they ask for none."""
    rest, at = list(arguments), next((k for k, word in enumerate(arguments) if word in HELP), None)
    if at is None:
        return rest, None
    page = rest[at + 1] if at + 1 < len(rest) and not rest[at + 1].startswith("-") else ""
    if page:
        del rest[at + 1]
    return rest, page


def _print(text: str, words: str, page: str) -> None:
    head, boxes = _read(text)
    groups = {box.group: None for box in boxes if box.group}
    if page not in ("", ALL, *groups):
        raise ConfigError(
            f"there is no help on {page!r}; {words} --help takes {', '.join((*groups, ALL))}, or nothing."
        )
    if page == ALL or len(boxes) <= _FEW_BOXES:
        print(text, end="")
    elif page:
        _print_boxes([box for box in boxes if box.group == page])
    else:
        print("\n".join(head))
        _print_boxes([box.with_flags(lambda flag: "." not in flag) for box in boxes])
        _print_groups(words, [box for box in boxes if box.group])


def _print_boxes(boxes: Sequence[_Box]) -> None:
    for box in boxes:
        if box.flags:
            print("\n".join(box.lines()))


def _print_groups(words: str, boxes: Sequence[_Box]) -> None:
    """Which other pages there are."""
    console = Console()
    console.print(
        f"\nMore settings; {words} --help GROUP shows those of a group, --help {ALL} every one:", highlight=False
    )
    table = Table(box=None, show_header=False, padding=(0, 0, 0, 2))
    for group in dict.fromkeys(box.group for box in boxes):
        own = [box.summary for box in boxes if box.title == group]
        parts = dict.fromkeys(box.title.split(".")[1] for box in boxes if box.group == group and box.title != group)
        table.add_row(group, " ".join((*own, *([f"Parts: {', '.join(parts)}."] if parts else []))))
    console.print(table)


def _read(text: str) -> tuple[list[str], list[_Box]]:
    """What stands before the boxes, and the boxes."""
    head, boxes, lines = list[str](), list[_Box](), iter(text.splitlines())
    for line in lines:
        top = _TOP.match(_COLORS.sub("", line))
        if top is not None:
            boxes.append(_box(top["title"].removesuffix("options").strip(), line, lines))
        elif not boxes:
            head.append(line)
    return head, boxes


def _box(title: str, top: str, lines: Iterator[str]) -> _Box:
    about, flags = [top], list[tuple[str, list[str]]]()
    for line in lines:
        plain = _COLORS.sub("", line)
        if plain.startswith("╰"):
            return _Box(title, tuple(about), tuple((flag, tuple(its)) for flag, its in flags), line)
        flag = _FLAG.match(plain)
        if flag is not None:
            flags.append((flag["flag"], [line]))
        else:
            (flags[-1][1] if flags else about).append(line)
    raise AssertionError(f"the box {title} of the help has no end")
