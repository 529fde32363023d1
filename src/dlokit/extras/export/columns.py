"""Messages of one topic as a table: one row for each message, one column for each field."""

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.recording.reader import Recorded


@dataclass(frozen=True, kw_only=True)
class Column:
    """One field over all messages."""

    name: str
    """Path of the field, e.g. ``"T_world_tcp.position_m"``, ``"findings[0].amount"``."""
    values: NDArray[Any]
    """(T, …) one row for each message; NaN or an empty text if a message lacks the field. If the shape differs between
    messages (clouds): (sum of lengths, …), concatenated."""
    first: NDArray[np.int64] | None = None
    """(T + 1,) start of each message's part, and the end of the last; None if each message has one row."""


def columns(messages: Sequence[Recorded]) -> list[Column]:
    """All fields of the messages of one topic, and `log_ns`, the time at which each was received."""
    rows = [dict(_flat(one.message, "")) for one in messages]
    names = dict.fromkeys(name for row in rows for name in row)
    log_ns = Column(name="log_ns", values=np.array([one.log_ns for one in messages], dtype=np.int64))
    found = [_column(name, [row.get(name) for row in rows]) for name in names]
    return [log_ns, *(column for column in found if column is not None)]


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        if isinstance(tag, str):
            yield f"{name}.kind".lstrip("."), tag
        for field in value.__struct_fields__:
            yield from _flat(getattr(value, field), f"{name}.{field}".lstrip("."))
    elif isinstance(value, tuple | list):
        for number, item in enumerate(value):
            yield from _flat(item, f"{name}[{number}]")
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}")
    elif isinstance(value, enum.Enum):
        yield name, value.value
    else:
        yield name, value


def _column(name: str, values: list[Any]) -> Column | None:
    there = [value for value in values if value is not None]
    if not there or all(isinstance(value, np.ndarray) and value.size == 0 for value in there):
        return None
    first = there[0]
    if isinstance(first, str):
        return Column(name=name, values=np.array([value or "" for value in values], dtype=np.str_))
    if isinstance(first, np.ndarray):
        return _array_column(name, values, first)
    if len(there) == len(values):
        return Column(name=name, values=np.array(values))
    return Column(name=name, values=np.array([np.nan if value is None else value for value in values], dtype=float))


def _array_column(name: str, values: list[Any], first: NDArray[Any]) -> Column:
    if all(value is None or value.shape == first.shape for value in values):
        if all(value is not None for value in values):
            return Column(name=name, values=np.stack(values))
        missing = np.full(first.shape, np.nan)
        return Column(
            name=name, values=np.stack([missing if value is None else value.astype(float) for value in values])
        )
    empty = first[:0]
    parts = [empty if value is None else value for value in values]
    lengths = [0, *(len(part) for part in parts)]
    return Column(name=name, values=np.concatenate(parts), first=np.cumsum(lengths, dtype=np.int64))
