"""The options of a command, read from the fields of its dataclasses: names, values, defaults and sentences."""

import ast
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

import tyro

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
    options: tuple[Option, ...]

    @property
    def name(self) -> str:
        """The outermost group: `cell`."""
        return self.path.partition(".")[0]


@dataclass(frozen=True)
class _Setting:
    """A field of a dataclass, its value, and what is known of its type."""

    name: str
    value: Any
    kind: Any
    """Its type without the notes."""
    notes: tuple[Any, ...]
    about: str

    @property
    def group(self) -> Any:
        """Its class, where it has settings of its own; else None."""
        if is_typeddict(self.kind):
            return self.kind
        return type(self.value) if is_dataclass(self.value) else None

    @property
    def argument(self) -> Any:
        """What it says to tyro about itself."""
        return next((note for note in self.notes if isinstance(note, _ARGUMENT)), tyro.conf.arg())


def groups_of(arguments: Any) -> list[OptionGroup]:
    """All options of a command whose arguments are `arguments`, a dataclass with the values that hold by default.

    Nested dataclasses and dictionaries with typed keys are groups; those without a name of their own add to the group
    that they are in.
    """
    return _merged(_groups(type(arguments), arguments, "", ""))


def _merged(groups: Iterator[OptionGroup]) -> list[OptionGroup]:
    """Groups with at least one option, each path once, in the order of their first options."""
    merged: dict[str, OptionGroup] = {}
    for group in groups:
        if group.options:
            first = merged.get(group.path)
            options = group.options if first is None else first.options + group.options
            about = group.about if first is None else first.about
            merged[group.path] = OptionGroup(path=group.path, about=about, options=options)
    return list(merged.values())


def _groups(kind: Any, settings: Any, path: str, about: str) -> Iterator[OptionGroup]:
    members = [one for one in _settings(kind, settings) if not any(note in _HIDDEN for note in one.notes)]
    options = tuple(_option(one, path) for one in members if one.group is None)
    yield OptionGroup(path=path, about=about, options=options)
    for one in members:
        if one.group is not None:
            yield from _groups(one.group, one.value, _path(path, one), one.about)


def _path(path: str, setting: _Setting) -> str:
    name = setting.name if setting.argument.name is None else setting.argument.name
    return ".".join(part for part in (path, name.replace("_", "-")) if part)


def _settings(kind: Any, settings: Any) -> Iterator[_Setting]:
    hints, about = get_type_hints(kind, include_extras=True), docstrings(kind)
    values = settings if is_typeddict(kind) else {one.name: getattr(settings, one.name) for one in fields(kind)}
    for name in hints if is_typeddict(kind) else values:
        of, notes = hints[name], ()
        if get_origin(of) is Annotated:
            of, *notes = get_args(of)
        yield _Setting(name, values.get(name), of, tuple(notes), about.get(name, ""))


@cache
def docstrings(settings: type[Any]) -> dict[str, str]:
    """What stands under each field of a class, in one line; empty for one typed into an interpreter."""
    found: dict[str, str] = {}
    for base in reversed(settings.__mro__):
        if is_dataclass(base) or is_typeddict(base):
            found |= _own_docstrings(base)
    return found


def _own_docstrings(settings: type[Any]) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(settings))
    except (OSError, TypeError):
        return {}
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    return {
        node.target.id: " ".join(inspect.cleandoc(below.value.value).split())
        for node, below in pairwise(body)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)
    }


def _option(setting: _Setting, path: str) -> Option:
    names = sorted((*(setting.argument.aliases or ()), f"--{_path(path, setting)}"), key=len)
    return Option(
        names=tuple(names),
        value=_value(setting),
        switched_on=setting.value is True,
        about=setting.about,
        default=_default(setting),
    )


def _value(setting: _Setting) -> str:
    argument = setting.argument
    if argument.metavar is not None:
        return argument.metavar
    return _in_words(setting.kind if argument.constructor_factory is None else argument.constructor_factory())


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


def _default(setting: _Setting) -> str:
    hint = setting.argument.help_behavior_hint
    if hint:
        return str(hint)
    if isinstance(setting.value, bool) or setting.value in (None, "", ()):
        return ""
    value = " ".join(map(str, setting.value)) if isinstance(setting.value, tuple) else setting.value
    return f"(default: {value})"
