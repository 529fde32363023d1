"""The help pages of a command: the most used options first, then one page for each group of settings.

A run has many settings and tyro lists all of them; a first-time user needs a dozen.
"""

import contextlib
import io
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from dlokit.errors import ConfigError

T = TypeVar("T")

HELP = ("-h", "--help")
ALL = "all"
_FEW_BOXES = 4
"""Help text with at most this many boxes is shown completely."""
_COLORS = re.compile(r"\x1b\[[0-9;]*m")
_TOP = re.compile(r"^╭─ (?P<title>\S+(?: \S+)*) ─+╮$")
_FLAG = re.compile(r"^│ (?P<flag>-\S+)")
_SENTENCE_END = re.compile(r"(?<!e\.g)[.;](?=\s)")
_NO_VALUES = ("", "None", "False", "True")
_OPTION_WIDTH = 25
"""Width of the column of options on the first page [characters]: the longest option and its value."""
_FIRST_PARAGRAPHS = 3
"""Paragraphs on the first page: usage, purpose, examples."""
_NARROWEST = 80
_WIDEST = 110
"""Maximum width of the first page [characters]: longer lines are hard to read."""


@dataclass(frozen=True)
class _Box:
    """A box of tyro's help text, line by line."""

    title: str
    """The group of settings, e.g. `cell.dlo`; empty: the command's own options."""
    about: tuple[str, ...]
    """Lines above the flags, including the borders."""
    flags: tuple[tuple[str, tuple[str, ...]], ...]
    """Each flag with its lines."""
    bottom: str

    @property
    def group(self) -> str:
        return self.title.partition(".")[0]

    @property
    def summary(self) -> str:
        """The purpose of the settings in one line."""
        lines = (_COLORS.sub("", line).strip("│ ") for line in self.about[1:])
        return " ".join(line for line in lines if line.strip("─"))

    def with_flags(self, wanted: Callable[[str], bool]) -> "_Box":
        return _Box(self.title, self.about, tuple(each for each in self.flags if wanted(each[0])), self.bottom)

    def briefs(self) -> Iterator[tuple[str, str]]:
        """Each flag with its value as one string, and the first sentence of its description."""
        for _, lines in self.flags:
            first, *others = (_COLORS.sub("", line).strip("│").strip() for line in lines)
            option, gap, text = first.partition("  ")
            text = " ".join((text.strip(), *others) if gap else others)
            yield _short_option(option, text), _first_sentence(text)

    def lines(self) -> Iterator[str]:
        yield from self.about
        for _, lines in self.flags:
            yield from lines
        yield self.bottom


class _Page(io.StringIO):
    """Captures printed text, with the colors and the width of the terminal."""

    @property
    def encoding(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]  # read-only here
        return getattr(sys.__stdout__, "encoding", None) or "ascii"

    def isatty(self) -> bool:
        return sys.__stdout__ is not None and sys.__stdout__.isatty()


def paged(words: str, arguments: Sequence[str], parse: Callable[[list[str]], T]) -> T:
    """Return the parsed arguments of the command `words`; if they request help, print that help page instead.

    Raises `ConfigError` for an unknown help page; `SystemExit` after a page, and where `parse` does.
    """
    rest, page = _asked(arguments)
    if page is None:
        return parse(rest)
    caught = _Page()
    try:
        with contextlib.redirect_stdout(caught):
            return parse(rest)
    except SystemExit:
        if caught.getvalue():  # otherwise another argument was wrong, and the error has been printed
            _print(caught.getvalue(), words, page)
        raise


def _asked(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The arguments without the help request, and the page: empty for the first page, None without a request."""
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
            f"there is no help page {page!r}; {words} --help takes {', '.join((*groups, ALL))}, or nothing."
        )
    if page == ALL or len(boxes) <= _FEW_BOXES:
        print(text, end="")
    elif page:
        _print_boxes([box for box in boxes if box.group == page])
    else:
        _print_first_page(words, head, boxes)


def _print_boxes(boxes: Sequence[_Box]) -> None:
    for box in boxes:
        if box.flags:
            print("\n".join(box.lines()))


def _print_first_page(words: str, head: Sequence[str], boxes: Sequence[_Box]) -> None:
    """Print the most used options and the list of other pages; fits two screens of a terminal."""
    width = Console().width
    console = Console(width=min(max(width, _NARROWEST), _WIDEST))
    paragraphs = "\n".join(head).split("\n\n")
    print("\n\n".join(paragraphs[:_FIRST_PARAGRAPHS]), end="\n\n")
    options = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
    options.add_column(width=_OPTION_WIDTH, no_wrap=True, style="bold")
    options.add_column()
    for box in boxes:
        for option, sentence in box.with_flags(lambda flag: "." not in flag).briefs():
            if option not in HELP:
                options.add_row(Text(option), Text(sentence))
    console.print(Padding(options, (0, 0, 1, 2)))
    groups = ", ".join(dict.fromkeys(box.group for box in boxes if box.group))
    more = f"More: {words} --help {ALL}, or --help GROUP for one group of settings: {groups}."
    console.print(more, highlight=False)


def _short_option(text: str, about: str) -> str:
    """The first name of an option and its value; NAME if its choices are too long.

    A flag that is on by default becomes `--[no-]name`.
    """
    short = text.partition(", -")[0]
    name, _, value = short.partition(" ")
    if about.endswith("(default: True)"):
        return f"--[no-]{name[2:]}"
    value = value.removeprefix("{None}|").strip("{}") if value.startswith("{None}|") else value
    return f"{name} {value}".rstrip() if len(name) + len(value) < _OPTION_WIDTH else f"{name} NAME"


def _first_sentence(text: str) -> str:
    """The first sentence of a help text, with the default if it is a value."""
    about, _, default = text.partition("(default: ")
    sentence = _SENTENCE_END.split(about.strip(), maxsplit=1)[0].rstrip(".")
    default = default.rstrip(") ")
    return sentence if default in _NO_VALUES else f"{sentence} [{default}]"


def _read(text: str) -> tuple[list[str], list[_Box]]:
    """The lines before the boxes, and the boxes."""
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
    raise AssertionError(f"the box {title} of the help text has no end")
