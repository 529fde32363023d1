"""Lossless conversion of messages to JSON and back, with schemas that Foxglove can read.

Foxglove's reader does not support unions or nested arrays. Hence an array is an object with its dtype, its shape and
either its values in one flat list, which can be plotted, or their bytes; the schema of an optional field omits None.
"""

import base64
import enum
import math
import types
from functools import lru_cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.communication.wire.codec import ALLOWED_DTYPES, LARGEST_RANK
from dlokit.errors import CommunicationError

T = TypeVar("T")

LARGEST_LISTED = 512
"""Arrays with more elements are written as bytes; the nodes and covariances of a DLO are listed, clouds are not."""

_ARRAY_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "dtype": {"type": "string"},
        "shape": {"type": "array", "items": {"type": "integer"}},
        "values": {"type": "array", "items": {"type": "number"}},
        "base64": {"type": "string", "contentEncoding": "base64"},
    },
}
_PRIMITIVES: dict[Any, dict[str, Any]] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    str: {"type": "string"},
    bytes: {"type": "string", "contentEncoding": "base64"},
}


def to_json(value: object) -> bytes:
    """Convert a message or a value to JSON; NaN and infinity become the strings ``"NaN"``, ``"Infinity"``."""
    return msgspec.json.encode(_plain(value))


def from_json(data: bytes, wanted: type[T]) -> T:
    """Decode a message of type `wanted` from JSON. Raises `CommunicationError` when `data` is anything else."""
    return from_plain(parsed_json(data), wanted)


def parsed_json(data: bytes) -> Any:
    """JSON as plain values. Raises `CommunicationError` for anything else, and for JSON that is nested too deeply."""
    try:
        return msgspec.json.decode(data)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise CommunicationError(f"a message is not JSON that can be read: {error}") from error


def from_plain(plain: object, wanted: type[T]) -> T:
    """Like `from_json`, from parsed JSON, which may also contain NumPy arrays."""
    try:
        # Not strict: JSON has NaN and infinity as strings.
        return msgspec.convert(plain, wanted, strict=False, dec_hook=_array_hook)
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise CommunicationError(f"cannot decode {kind_name(wanted)} from JSON: {error}") from error


def json_schema(kind: Any) -> bytes:
    """The JSON schema of a message type."""
    return msgspec.json.encode(_schema(kind))


def kind_name(kind: Any) -> str:
    """Name of a type, or of the members of a union."""
    return "|".join(part.__name__ for part in get_args(kind) or (kind,))


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else _name_of_nonfinite(value)
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, np.ndarray):
        return _plain_array(value)
    if isinstance(value, msgspec.Struct):
        fields = ((name, getattr(value, name)) for name in value.__struct_fields__)
        plain = {name: _plain(part) for name, part in fields if not (isinstance(part, dict) and not part)}
        config = value.__struct_config__
        return plain if config.tag_field is None else {config.tag_field: config.tag, **plain}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):  # a Struct decoded without its type
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    raise CommunicationError(f"{type(value).__name__} cannot be recorded; allowed: the types of messages' fields")


def _name_of_nonfinite(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    return "Infinity" if value > 0 else "-Infinity"


def _plain_array(array: NDArray[Any]) -> dict[str, Any]:
    listed = array.size <= LARGEST_LISTED and (array.dtype.kind != "f" or bool(np.isfinite(array).all()))
    numbers = array.astype(np.uint8) if array.dtype.kind == "b" else array
    return {
        "dtype": array.dtype.str,
        "shape": list(array.shape),
        "values": numbers.ravel().tolist() if listed else [],
        "base64": "" if listed else base64.b64encode(array.tobytes()).decode(),
    }


def _array_hook(wanted: Any, value: Any) -> NDArray[Any]:
    dtype = np.dtype(get_args(get_args(wanted)[1])[0])
    array = value if isinstance(value, np.ndarray) else _array_from(value)
    if array.dtype != dtype:
        raise CommunicationError(f"an array of {dtype} is expected, not of {array.dtype}")
    array.flags.writeable = False
    return array


def _array_from(value: dict[str, Any]) -> NDArray[Any]:
    dtype, shape = value["dtype"], value["shape"]
    if dtype not in ALLOWED_DTYPES or len(shape) > LARGEST_RANK:
        raise CommunicationError(f"array of dtype {dtype!r} refused; allowed: {sorted(ALLOWED_DTYPES)}")
    if value["base64"]:
        return np.frombuffer(base64.b64decode(value["base64"]), dtype=dtype).reshape(shape)
    return np.array(value["values"], dtype=dtype).reshape(shape)


def _schema(kind: Any) -> dict[str, Any]:
    if kind in _PRIMITIVES:
        return _PRIMITIVES[kind]
    origin, parts = get_origin(kind), get_args(kind)
    if origin is np.ndarray:
        return _ARRAY_SCHEMA
    if origin in (Union, types.UnionType):
        kinds = [part for part in parts if part is not types.NoneType]
        return _schema(kinds[0]) if len(kinds) == 1 else _all_of(kinds)
    if origin in (tuple, list):
        return {"type": "array", "items": _schema(parts[0])}
    if issubclass(kind, enum.Enum):
        return {"type": "string"}
    tag_field = kind.__struct_config__.tag_field
    properties = {} if tag_field is None else {tag_field: _PRIMITIVES[str]}
    # Foxglove needs the names of all fields, and those of a dict differ from message to message.
    properties |= {name: _schema(hint) for name, hint in _fields(kind).items() if get_origin(hint) is not dict}
    return {"title": kind.__name__, "type": "object", "properties": properties}


def _all_of(kinds: list[Any]) -> dict[str, Any]:
    """Schema of a union of messages: one object with the fields of all members."""
    merged: dict[str, Any] = {}
    for kind in kinds:
        schema = _schema(kind)
        if schema["type"] != "object":
            raise CommunicationError(f"{kinds} have no common schema; allowed: unions of messages, and with None")
        merged |= schema["properties"]
    return {"type": "object", "properties": merged}


@lru_cache(maxsize=128)
def _fields(kind: type[msgspec.Struct]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {name: hints[name] for name in kind.__struct_fields__}
