"""The help pages of a command: the most used options first, then one page for each group of settings.

A run has many settings and a first-time user needs a dozen. Other commands use tyro's own help. For a run that is one
page of 523 lines, and its sentences are broken where the docstrings' lines end. tyro has no page for a group; its
compact help omits all sentences; `tyro.extras.get_parser`, which could list the options, is deprecated.
"""

import inspect
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

import tyro
from rich.console import Console
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from dlokit.errors import ConfigError
from dlokit.ranges import docstrings_of

HELP = ("-h", "--help")
ALL = "all"
FEW_GROUPS = 3
"""Help text with at most this many groups is shown completely, by tyro."""
_SENTENCE_END = re.compile(r"(?<!e\.g)[.;](?=\s)")
_OPTION_WIDTH = 25
"""Width of the column of options on the first page [characters]: the longest option and its value."""
_FIRST_PARAGRAPHS = 2
"""Paragraphs on the first page: what the command does, examples."""
_NARROWEST = 80
_WIDEST = 110
"""Maximum width of the first page [characters]: longer lines are hard to read."""
_ARGUMENT = type(tyro.conf.arg())
_HIDDEN = (tyro.conf.Suppress, tyro.conf.Fixed)
_VALUES = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}


@dataclass(frozen=True, kw_only=True)
class Option:
    """One option, as the command line takes it."""

    names: tuple[str, ...]
    """The shortest first: `--threshold-m`, `--task.threshold-m`."""
    value: str
    """What follows it, `FLOAT`; empty for a switch."""
    switched_on: bool
    """Whether it is a switch that is on unless its `--no-` form is given."""
    about: str
    """What the setting does, as its docstring says."""
    default: str
    """The value without the option, in words; empty where there is nothing to say."""


@dataclass(frozen=True, kw_only=True)
class OptionGroup:
    """The options of one dataclass."""

    path: str
    """`cell.dlo`; empty for the options without a group."""
    about: str
    """What the settings are for."""
    options: list[Option] = field(default_factory=list[Option])

    @property
    def name(self) -> str:
        """The outermost group: `cell`."""
        return self.path.partition(".")[0]


def groups_of(arguments: Any) -> list[OptionGroup]:
    """All options of a command whose arguments are `arguments`, a dataclass with the values that hold by default.

    Nested dataclasses, and dictionaries with typed keys, are groups; those without a name of their own add to the
    group that they are in.
    """
    found: dict[str, OptionGroup] = {}
    _collect(type(arguments), arguments, "", "", found)
    return [group for group in found.values() if group.options]


def _collect(of: Any, settings: Any, path: str, about: str, found: dict[str, OptionGroup]) -> None:
    hints, texts = get_type_hints(of, include_extras=True), docstrings_of(of)
    values = settings if is_typeddict(of) else {each.name: getattr(settings, each.name) for each in fields(of)}
    group = found.setdefault(path, OptionGroup(path=path, about=about))
    nested: list[tuple[Any, Any, str, str]] = []
    for field_name in hints if is_typeddict(of) else values:
        hint, value = hints[field_name], values.get(field_name)
        kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if any(note in _HIDDEN for note in notes):
            continue
        argument: Any = next((note for note in notes if isinstance(note, _ARGUMENT)), tyro.conf.arg())
        name = field_name if argument.name is None else argument.name
        below = ".".join(part for part in (path, name.replace("_", "-")) if part)
        text = texts.get(field_name, "")
        if is_dataclass(value) or is_typeddict(kind):
            nested.append((kind if is_typeddict(kind) else type(value), value, below, text))
            continue
        wanted = kind if argument.constructor_factory is None else argument.constructor_factory()
        option = Option(
            names=tuple(sorted((*(argument.aliases or ()), f"--{below}"), key=len)),
            value=_in_words(wanted) if argument.metavar is None else argument.metavar,
            switched_on=value is True,
            about=text,
            default=str(argument.help_behavior_hint or _default(value)),
        )
        group.options.append(option)
    for inner, value, below, text in nested:
        _collect(inner, value, below, text, found)


def _in_words(kind: Any) -> str:
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _in_words(parts[0])
    if origin is Literal:
        return "{" + ",".join(str(part) for part in parts) + "}"
    if origin in (Union, UnionType):
        return "|".join(_in_words(part) for part in parts if part is not NoneType)
    if origin is tuple and parts[1:] == (...,):
        return f"[{_in_words(parts[0])} ...]"
    if origin is tuple:
        return " ".join(_in_words(part) for part in parts)
    return "" if kind is bool else _VALUES.get(kind, "VALUE")


def _default(value: Any) -> str:
    if isinstance(value, bool) or value in (None, "", ()):
        return ""
    return f"(default: {' '.join(map(str, value)) if isinstance(value, tuple) else value})"


def asked_page(arguments: Sequence[str]) -> tuple[list[str], str | None]:
    """The arguments without the help request, and the page: empty for the first page, None without a request."""
    rest, at = list(arguments), next((k for k, word in enumerate(arguments) if word in HELP), None)
    if at is None:
        return rest, None
    page = rest[at + 1] if at + 1 < len(rest) and not rest[at + 1].startswith("-") else ""
    if page:
        del rest[at + 1]
    return rest, page


def printed(words: str, arguments: Any, page: str, unused: frozenset[str] = frozenset()) -> bool:
    """Print a help page of the command `words` with these arguments; False where tyro's own help is enough.

    `page` is a group, `all`, or empty for the first page, which omits the options `unused`. Raises `ConfigError` for
    any other.
    """
    groups = groups_of(arguments)
    names = tuple(dict.fromkeys(group.name for group in groups if group.name))
    if len(names) <= FEW_GROUPS:
        return False
    about = inspect.getdoc(type(arguments)) or ""
    if page == "":
        _print_first_page(words, about, groups, names, unused)
    elif page == ALL:
        print(f"usage: {words} [OPTIONS]\n\n{about}\n")
        _print_groups(groups)
    elif page in names:
        _print_groups([group for group in groups if group.name == page])
    else:
        raise ConfigError(f"there is no help on {page!r}; {words} --help takes {', '.join((*names, ALL))}, or nothing.")
    return True


def _print_groups(groups: Sequence[OptionGroup]) -> None:
    console = Console(highlight=False)
    for group in groups:
        text = Text("\n").join(_paragraphs(group))
        console.print(Panel(text, title=f"{group.path} options".strip(), title_align="left", border_style="dim"))


def _paragraphs(group: OptionGroup) -> Iterator[Text]:
    inner_width = max(Console().width - 10, 20)  # of the box, without its borders and their indentation
    if group.path and group.about:
        yield Text(f"{group.about}\n")
    for option in group.options:
        yield Text(_with_value(option), style="bold")
        about = Text.assemble(option.about, " ", (option.default, "dim")) if option.default else Text(option.about)
        yield from (Text.assemble("      ", line) for line in about.wrap(Console(), inner_width))


def _with_value(option: Option) -> str:
    names = list(option.names)
    if option.switched_on:
        path, dot, last = names[0][2:].rpartition(".")
        names.append(f"--{path}{dot}no-{last}")
    return ", ".join(f"{name} {option.value}".rstrip() for name in names)


def _print_first_page(
    words: str, about: str, groups: Sequence[OptionGroup], names: Sequence[str], unused: frozenset[str]
) -> None:
    """What people use first, an option a line or two, and which other pages there are: two screens of a terminal."""
    console = Console(width=min(max(Console().width, _NARROWEST), _WIDEST), highlight=False)
    paragraphs = about.split("\n\n")[:_FIRST_PARAGRAPHS]
    print(f"usage: {words} [OPTIONS]", "\n\n".join(paragraphs), sep="\n", end="\n\n")
    table = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
    table.add_column(width=_OPTION_WIDTH, no_wrap=True, style="bold")
    table.add_column()
    for group in groups:
        for option in group.options:
            if "." not in option.names[0] and option.names[0] not in unused:
                table.add_row(Text(_short(option)), Text(_first_sentence(option)))
    console.print(Padding(table, (0, 0, 1, 2)))
    console.print(f"More: {words} --help {ALL}, or --help GROUP for one group of settings: {', '.join(names)}.")


def _short(option: Option) -> str:
    """The option and its value; NAME where its choices take too much room, `--[no-]name` where it is on."""
    name = option.names[0]
    if option.switched_on:
        return f"--[no-]{name[2:]}"
    return f"{name} {option.value}".rstrip() if len(name) + len(option.value) < _OPTION_WIDTH else f"{name} NAME"


def _first_sentence(option: Option) -> str:
    """The first sentence of a help text, with the default."""
    sentence = _SENTENCE_END.split(option.about, maxsplit=1)[0].rstrip(".")
    default = option.default.removeprefix("(default: ").removesuffix(")")
    return f"{sentence} [{default}]" if default else sentence
