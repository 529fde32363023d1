"""Configuration dataclasses to TOML and back, with errors that name the key, the value and what is allowed.

A union of dataclasses (a strategy) is a table with ``kind = "<class name>"``. None is an absent key.
"""

import dataclasses
import tomllib
import types
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import tomli_w

from dlokit.errors import ConfigError

C = TypeVar("C")
KIND = "kind"


def to_toml(config: object) -> str:
    """The whole configuration as TOML."""
    return tomli_w.dumps(to_plain(config, union=False))


def from_toml(text: str, wanted: type[C], source: str) -> C:
    """A configuration from TOML; `source` is named in errors. Raises `ConfigError`."""
    try:
        plain = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source} is not TOML: {error}; write one with `dlokit shape --out DIR`") from error
    return from_plain(plain, wanted, source)


def read_toml(path: Path, wanted: type[C]) -> C:
    """A configuration from a file. Raises `ConfigError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"configuration {path} cannot be read: {error}; every run writes one to config.toml"
        ) from error
    return from_toml(text, wanted, str(path))


def to_plain(value: Any, *, union: bool) -> Any:
    """Dataclasses to dictionaries; `union` adds the kind."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        hints = get_type_hints(type(value))
        plain: dict[str, Any] = {KIND: type(value).__name__} if union else {}
        for field in dataclasses.fields(value):
            item = getattr(value, field.name)
            if item is not None:
                plain[field.name] = to_plain(item, union=len(_members(hints[field.name])) > 1)
        return plain
    if isinstance(value, tuple | list):
        return [to_plain(item, union=False) for item in value]
    return msgspec.to_builtins(value)


def from_plain(plain: Any, wanted: Any, where: str) -> Any:
    """The inverse of `to_plain`. Raises `ConfigError`."""
    members = _members(wanted)
    if not members:
        try:
            return msgspec.convert(plain, wanted)
        except msgspec.ValidationError as error:
            raise ConfigError(f"{where}: {error}, got {plain!r}") from error
    if not isinstance(plain, dict):
        raise ConfigError(f"{where}: a table is expected, got {plain!r}")
    table: dict[str, Any] = dict(plain)
    kind = table.pop(KIND, None)
    names = {member.__name__: member for member in members}
    if kind is None and len(members) > 1:
        raise ConfigError(f"{where}: lacks `{KIND}`; allowed: {', '.join(names)}")
    if kind is not None and kind not in names:
        raise ConfigError(f"{where}: unknown {KIND} {kind!r}; allowed: {', '.join(names)}")
    return _dataclass_from(table, names[kind] if kind else members[0], where)


def _dataclass_from(table: dict[str, Any], wanted: type[Any], where: str) -> Any:
    hints = get_type_hints(wanted)
    fields = {field.name for field in dataclasses.fields(wanted)}
    unknown = sorted(set(table) - fields)
    if unknown:
        raise ConfigError(f"{where}: unknown key {', '.join(unknown)}; allowed: {', '.join(sorted(fields))}")
    values = {name: from_plain(value, hints[name], f"{where}: {name}") for name, value in table.items()}
    try:
        return wanted(**values)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{where}: {error}") from error


def _members(wanted: Any) -> list[type[Any]]:
    """The dataclasses that `wanted` is, or is a union of; empty for scalars and tuples."""
    options = get_args(wanted) if get_origin(wanted) in (Union, types.UnionType) else (wanted,)
    return [option for option in options if dataclasses.is_dataclass(option) and isinstance(option, type)]
