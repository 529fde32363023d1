"""Converts configuration dataclasses to TOML and back; errors name the key, the value and the allowed values.

A strategy is a table with ``kind = "<its name>"``, in every package; any other union of dataclasses is a table
with ``kind = "<class name>"``, or the `kind` that the class has. None is an absent key.

`msgspec.convert` reads the values. It cannot read the tables: it refuses a union of two dataclasses, does not support
strategies of other packages, and ignores keys that a dataclass does not have. Our walk over the tables takes 1.4 ms
for a run's file.
"""

import dataclasses
import tomllib
import types
from collections.abc import Iterator
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgspec
import tomli_w

from dlokit.communication.strategies import StrategyKind
from dlokit.errors import ConfigError
from dlokit.system.configuration.renamed import with_present_names

C = TypeVar("C")
KIND = "kind"


def to_toml(config: object) -> str:
    """The whole configuration as TOML."""
    return tomli_w.dumps(to_plain(config))


def from_toml(text: str, wanted: type[C], source: str, advice: str = "`dlokit shape --out DIR` writes one") -> C:
    """A configuration from TOML; errors name `source`, text that is not TOML also `advice`. Raises `ConfigError`."""
    try:
        plain = with_present_names(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source} is not TOML: {error}; {advice}") from error
    gone = known_part(plain, wanted)[1]
    near = {path: hint for path in gone if (hint := _meant(path, plain, wanted))}
    if near:
        named = ", ".join(f"{path} ({near[path]})" if path in near else path for path in gone)
        raise ConfigError(f"{source}: there is no setting {named}")
    if len(gone) > 1:
        raise ConfigError(
            f"{source}: this version has no settings {', '.join(gone)}: it is the file of another one; delete these, "
            f"`dlokit shape --help all` shows those there are"
        )
    return from_plain(plain, wanted, source)


def read_toml(path: Path, wanted: type[C], advice: str = "every run writes one to config.toml") -> C:
    """Read a configuration file. Raises `ConfigError`; `advice` explains how to get the file."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"configuration {path} cannot be read: {error}; {advice}") from error
    return from_toml(text, wanted, str(path), advice)


def to_plain(value: Any, wanted: Any = None) -> Any:
    """Convert dataclasses to dictionaries, with their kind if the type `wanted` is ambiguous."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        hints = get_type_hints(type(value), include_extras=True)
        plain: dict[str, Any] = {}
        if _is_choice(wanted):
            plain[KIND] = next((name for name, member in _members(wanted).items() if member is type(value)), None)
            if plain[KIND] is None:
                raise ConfigError(
                    f"{type(value).__name__} is none of {', '.join(_members(wanted))}, so a file cannot name it; "
                    f"install its package with an entry point"
                )
        for field in dataclasses.fields(value):
            item = getattr(value, field.name)
            if item is not None:
                plain[field.name] = to_plain(item, hints[field.name])
        return plain
    if isinstance(value, tuple | list):
        row = _row(wanted)
        return [to_plain(item, row) for item in value]
    return msgspec.to_builtins(value)


def from_plain(plain: Any, wanted: Any, where: str) -> Any:
    """The inverse of `to_plain`. Raises `ConfigError`."""
    members = _members(wanted)
    if not members:
        if (kind := _strategy_kind(wanted)) is not None:
            raise ConfigError(f"{where}: no installed package has settings for {kind.purpose}; install one that has.")
        if (row := _row(wanted)) is not None:
            if not isinstance(plain, list):
                name = where.split(": ")[-1]
                raise ConfigError(f"{where} is not a list of tables: write [[{name}]] over each, in double brackets")
            items = cast(list[Any], plain)
            return tuple(from_plain(item, row, f"{where}[{number}]") for number, item in enumerate(items))
        try:
            return msgspec.convert(plain, _bare(wanted))
        except msgspec.ValidationError as error:
            raise ConfigError(f"{where}: {error}, got {plain!r}") from error
    if not isinstance(plain, dict):
        raise ConfigError(f"{where}: a table is expected, got {plain!r}")
    table: dict[str, Any] = dict(plain)
    kind = table.pop(KIND, None)
    if kind is None and _is_choice(wanted) and len(members) > 1:
        raise ConfigError(f"{where}: lacks `{KIND}`; allowed: {', '.join(members)}")
    if kind is not None and kind not in members:
        missing = "" if _strategy_kind(wanted) is None else "; is a package missing that brings it?"
        raise ConfigError(f"{where}: unknown {KIND} {kind!r}; allowed: {', '.join(members)}{missing}")
    return _dataclass_from(table, next(iter(members.values())) if kind is None else members[kind], where)


def known_part(plain: Any, wanted: Any, where: str = "") -> tuple[Any, list[str]]:
    """The settings in `plain` that this version has, and the names of the rest, for files of another version."""
    members = _members(wanted)
    if not members or not isinstance(plain, dict):
        return plain, []
    table = cast(dict[str, Any], plain)
    member = members.get(table[KIND]) if KIND in table else next(iter(members.values()))
    if member is None:
        return table, []
    hints = get_type_hints(member, include_extras=True)
    kept: dict[str, Any] = {}
    unknown: list[str] = []
    for name, value in table.items():
        path = f"{where}.{name}".lstrip(".")
        if name == KIND:
            kept[name] = value
        elif name in hints:
            kept[name], below = known_part(value, hints[name], path)
            unknown += below
        else:
            unknown.append(path)
    return kept, unknown


def _meant(path: str, plain: dict[str, Any], wanted: Any) -> str:
    """What an unknown setting of a file probably is: a similar name in its table, or its name in another; else empty.

    Of names that several other tables have, none is proposed.
    """
    table, _, name = path.rpartition(".")
    known = [one for one in _paths(plain, wanted) if one != path]
    beside = [one.rpartition(".")[2] for one in known if one.rpartition(".")[0] == table]
    if similar := get_close_matches(name, beside, n=1):
        return f"perhaps you meant {f'{table}.{similar[0]}'.lstrip('.')}"
    elsewhere = [one for one in known if one.rpartition(".")[2] == name]
    return f"{name} is {elsewhere[0]}" if len(elsewhere) == 1 else ""


def _paths(plain: Any, wanted: Any, where: str = "") -> Iterator[str]:
    """The paths of all settings and tables that a file may have; of a choice, those of the kind that `plain` names."""
    members = _members(wanted)
    table: dict[str, Any] = plain if isinstance(plain, dict) else {}
    member = members.get(table.get(KIND, "")) or next(iter(members.values()), None)
    if member is None:
        return
    for name, hint in get_type_hints(member, include_extras=True).items():
        path = f"{where}.{name}".lstrip(".")
        yield path
        yield from _paths(table.get(name), hint, path)


def _dataclass_from(table: dict[str, Any], wanted: type[Any], where: str) -> Any:
    hints = get_type_hints(wanted, include_extras=True)
    fields = {field.name: field for field in dataclasses.fields(wanted)}
    unknown = sorted(set(table) - set(fields))
    if unknown:
        meant = get_close_matches(unknown[0], fields, n=1)
        hint = f" (did you mean {meant[0]}?)" if meant else ""
        raise ConfigError(f"{where}: unknown key {', '.join(unknown)}{hint}; allowed: {', '.join(sorted(fields))}")
    if lacking := [name for name, field in fields.items() if _is_required(field) and name not in table]:
        raise ConfigError(f"{where}: lacks {', '.join(lacking)}; add it")
    values = {name: from_plain(value, hints[name], f"{where}: {name}") for name, value in table.items()}
    try:
        return wanted(**values)
    except (TypeError, ValueError, ConfigError) as error:
        raise ConfigError(f"{where}: {error}") from error


def _is_required(field: dataclasses.Field[Any]) -> bool:
    return field.init and field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _row(wanted: Any) -> Any:
    """The element type of a tuple of any number of dataclasses, also of an optional one; None for other types."""
    bare = _bare(wanted)
    for option in get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (bare,):
        match get_args(option):
            case (item, end) if end is ... and _members(item):
                return item
            case _:
                pass
    return None


def _bare(wanted: Any) -> Any:
    """The type without its annotations."""
    return get_args(wanted)[0] if get_origin(wanted) is Annotated else wanted


def _strategy_kind(wanted: Any) -> StrategyKind[Any] | None:
    """The kind of strategy declared in the annotation of a field."""
    notes = get_args(wanted)[1:] if get_origin(wanted) is Annotated else ()
    return next((note for note in notes if isinstance(note, StrategyKind)), None)


def _is_choice(wanted: Any) -> bool:
    return _strategy_kind(wanted) is not None or len(_members(wanted)) > 1


def _members(wanted: Any) -> dict[str, type[Any]]:
    """The dataclasses that `wanted` allows, by their kind; empty for scalars and tuples."""
    if (strategies := _strategy_kind(wanted)) is not None:
        return strategies.installed()
    bare = _bare(wanted)
    options = get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (bare,)
    return {
        getattr(option, KIND, option.__name__): option
        for option in options
        if dataclasses.is_dataclass(option) and isinstance(option, type)
    }
