"""Ranges and texts of settings: noted beside and under a setting, and checked in one place when the settings are made.

@dataclass(frozen=True, kw_only=True)
class LookConfig:
    pause_s: Positive = 0.1
    fraction: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5

    def __post_init__(self) -> None:
        check_ranges(self, "look")
"""

import ast
import inspect
import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints, is_typeddict

from msgspec import Meta

from dlokit.errors import ConfigError

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
Count = Annotated[int, Meta(ge=1)]


def check_ranges(settings: Any, group: str = "") -> None:
    """Refuse values outside the ranges and choices of a dataclass's field types, and numbers that are not finite.

    `group` is the path of the settings in the configuration, `cell.dlo`; empty for the configuration itself. A group
    that ends with a colon names a table of a file, whose settings are no options. Raises `ConfigError`, which names the
    option, its value, and what is allowed.
    """
    for name, kind in _kinds(type(settings)).items():
        value = getattr(settings, name)
        allowed = next(_violations(value, kind), None)
        if allowed is not None:
            raise ConfigError(f"{_option(group, name, kind)} is {value}; it must be {allowed}.")


@cache
def _kinds(settings: type[Any]) -> dict[str, Any]:
    """The type of each field, with what is noted beside it."""
    hints = get_type_hints(settings, include_extras=True)
    return {field.name: hints[field.name] for field in fields(settings)}


def _option(group: str, name: str, kind: Any) -> str:
    """How the command line or a file calls a setting: an option by its short name where it has one."""
    if group.endswith(":"):
        return f"{group} {name}"
    notes = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    short = [alias for note in notes for alias in getattr(note, "aliases", None) or ()]
    return short[0] if short else "--" + f"{group}.{name}".lstrip(".").replace("_", "-")


def _violations(value: Any, kind: Any) -> Iterator[str]:
    """What is allowed, for each part of `value` that does not keep to it."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        yield from _out_of_range(value, [note for note in parts[1:] if isinstance(note, Meta)])
        yield from _violations(value, parts[0])
    elif origin in (Union, UnionType):
        if value is not None:
            for part in parts:
                if part is not NoneType:
                    yield from _violations(value, part)
    elif origin is Literal:
        if value not in parts:
            yield f"one of {', '.join(map(str, parts))}"
    elif origin is tuple:
        each = (parts[0],) * len(value) if parts[1:] == (...,) else parts
        for item, part in zip(value, each, strict=False):
            yield from (f"{allowed} in each value" for allowed in _violations(item, part))
    elif isinstance(value, float) and not math.isfinite(value):
        yield "a finite number"


def _out_of_range(value: Any, ranges: list[Meta]) -> Iterator[str]:
    for allowed in ranges:
        above = (allowed.gt is None or value > allowed.gt) and (allowed.ge is None or value >= allowed.ge)
        below = (allowed.lt is None or value < allowed.lt) and (allowed.le is None or value <= allowed.le)
        if not (above and below):
            yield _in_words(allowed)


def _in_words(allowed: Meta) -> str:
    if allowed.ge is not None and allowed.le is not None:
        return f"{allowed.ge:g} to {allowed.le:g}"
    bounds = (
        (allowed.gt, "above {:g}"),
        (allowed.ge, "{:g} or greater"),
        (allowed.lt, "below {:g}"),
        (allowed.le, "at most {:g}"),
    )
    return " and ".join(words.format(bound) for bound, words in bounds if bound is not None)


@dataclass(frozen=True, kw_only=True)
class NumericSetting:
    """A setting that is a number."""

    name: str
    whole: bool
    """Whether it is a whole number."""
    least: float | None
    """Smallest value that is declared; None: none is."""
    most: float | None
    """Largest value that is declared; None: none is."""
    text: str
    """What it does, as its docstring says."""


def numeric_settings(settings: type[Any]) -> tuple[NumericSetting, ...]:
    """The settings of a dataclass that are numbers, in its order, with the ranges beside their types."""
    texts = docstrings_of(settings)
    found: list[NumericSetting] = []
    for name, hint in _kinds(settings).items():
        kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if kind not in (int, float):
            continue
        ranges = [note for note in notes if isinstance(note, Meta)]
        least = next((value for note in ranges for value in (note.ge, note.gt) if value is not None), None)
        most = next((value for note in ranges for value in (note.le, note.lt) if value is not None), None)
        found.append(
            NumericSetting(name=name, whole=kind is int, least=least, most=most, text=texts.get(name, "")),
        )
    return tuple(found)


@cache
def docstrings_of(settings: type[Any]) -> dict[str, str]:
    """The text under each field of a class, in one line; empty for a class that was typed into an interpreter."""
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
