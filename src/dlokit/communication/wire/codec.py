"""Encode messages as bytes and decode them: msgpack, with arrays as extension types.

Decoding executes nothing, checks every type, and allocates less than twice `LARGEST_MESSAGE_BYTES` for any input.
Decoded arrays are read-only, because readers share a message; large ones are views of the received bytes.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar, cast, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.communication.wire.schema import is_listing
from dlokit.errors import CommunicationError

T = TypeVar("T")

ARRAY_CODE = 1
ALLOWED_DTYPES = frozenset({"<f8", "<f4", "|u1", "<i8", "|b1"})
LARGEST_RANK = 4
LARGEST_MESSAGE_BYTES = 64 * 2**20
"""Longest message that is decoded: ten stereo pairs of 1024 by 896 pixels."""
LARGEST_LISTING_BYTES = 2 * 2**20
"""The same for types with any number of items: one byte of their encoding can need 40 bytes of memory."""
LARGE_ARRAY_BYTES = 2**14
LONGEST_HEAD_BYTES = 64
_PLAIN = (bool, int, float, str)


def _encode_hook(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(
            f"{type(value).__name__} cannot be sent; allowed: numbers, texts, containers, Structs, arrays"
        )
    array: NDArray[Any] = np.ascontiguousarray(value)
    head = _head_of(array.dtype, value.shape)
    return msgspec.msgpack.Ext(ARRAY_CODE, b"".join((head, array.data)))


@lru_cache(maxsize=1024)
def _head_of(dtype: "np.dtype[Any]", shape: tuple[int, ...]) -> bytes:
    """The header of an array: its own length, then dtype and shape."""
    if dtype.str not in ALLOWED_DTYPES:
        raise CommunicationError(
            f"an array of {dtype} cannot be sent; allowed: {sorted(ALLOWED_DTYPES)}; convert it with .astype()"
        )
    head = msgspec.msgpack.encode((dtype.str, shape))
    return len(head).to_bytes(2, "little") + head


_HEAD = msgspec.msgpack.Decoder(tuple[str, tuple[int, ...]])


@lru_cache(maxsize=1024)
def _read_head(head: bytes) -> "tuple[np.dtype[Any], tuple[int, ...], int]":
    """Dtype, shape, and the number of bytes of the values."""
    name, shape = _HEAD.decode(head)
    if name not in ALLOWED_DTYPES or len(shape) > LARGEST_RANK or any(n < 0 for n in shape):
        raise CommunicationError(
            f"array of dtype {name!r} and shape {shape} refused; allowed: {sorted(ALLOWED_DTYPES)}"
        )
    dtype = np.dtype(name)
    return dtype, shape, dtype.itemsize * math.prod(shape)


def _extension_hook(code: int, data: memoryview) -> NDArray[Any]:
    if code != ARRAY_CODE:
        raise CommunicationError(f"unknown extension type {code}; only {ARRAY_CODE} (array) is known")
    begin = 2 + int.from_bytes(data[:2], "little")
    dtype, shape, expected = _read_head(bytes(data[2 : min(begin, 2 + LONGEST_HEAD_BYTES)]))
    if len(data) - begin != expected:
        raise CommunicationError(
            f"an array of shape {shape} needs {expected} bytes, but {len(data) - begin} arrived: message is cut"
        )
    if expected >= LARGE_ARRAY_BYTES:
        array: NDArray[Any] = np.frombuffer(data[begin:], dtype=dtype)
        if not array.flags.aligned:
            array = np.frombuffer(bytes(data[begin:]), dtype=dtype)
    else:  # a small part must not keep a large message in memory
        array = np.frombuffer(bytes(data[begin:]), dtype=dtype)
    if dtype.kind == "b" and array.view(np.uint8).max(initial=0) > 1:
        raise CommunicationError("an array of bool has values other than 0 and 1: message is damaged")
    return array.reshape(shape)


@lru_cache(maxsize=64)
def _dtype_of(wanted: Any) -> "np.dtype[Any]":
    """The dtype that an annotation ``NDArray[dtype]`` names."""
    return np.dtype(get_args(get_args(wanted)[1])[0])


def _decode_hook(wanted: Any, value: Any) -> Any:
    dtype = _dtype_of(wanted)
    if not isinstance(value, np.ndarray) or value.dtype != dtype:
        found = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
        raise CommunicationError(f"an array of {dtype} is expected, but {found} arrived")
    return value


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_hook)


@lru_cache(maxsize=256)
def _decoder(wanted: Any) -> tuple[Callable[[bytes], Any], int]:
    """The decoding function of a type, and its longest message [bytes]."""
    decode = msgspec.msgpack.Decoder(wanted, ext_hook=_extension_hook, dec_hook=_decode_hook).decode
    return decode, largest_bytes(wanted)


def largest_bytes(wanted: Any) -> int:
    """Length of the longest message of a type that is accepted [bytes]."""
    return LARGEST_LISTING_BYTES if is_listing(wanted) else LARGEST_MESSAGE_BYTES


def encode(value: object) -> bytes:
    """Encode a value. Raises `CommunicationError` when a part of it cannot be sent."""
    bulk = _bulk_bytes(value)
    try:
        if bulk < LARGE_ARRAY_BYTES:
            return _ENCODER.encode(value)
        buffer = bytearray(bulk + LARGE_ARRAY_BYTES)  # growing a buffer takes twenty times as long
        _ENCODER.encode_into(value, buffer)
        return bytes(buffer)
    except (NotImplementedError, TypeError, ValueError, msgspec.MsgspecError) as error:
        raise _not_encodable(value, error) from error


def encode_into(value: object, buffer: bytearray) -> None:
    """Encode a value into `buffer`, replacing its content; a reused buffer need not grow."""
    try:
        _ENCODER.encode_into(value, buffer)
    except (NotImplementedError, TypeError, ValueError, msgspec.MsgspecError) as error:
        raise _not_encodable(value, error) from error


def _not_encodable(value: object, error: Exception) -> CommunicationError:
    return CommunicationError(f"cannot encode {type(value).__name__}: {error}")


def _bulk_bytes(value: object) -> int:
    """Total size of the arrays and byte strings in a value, including nested Structs [bytes]."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, bytes):
        return len(value)
    if isinstance(value, dict):
        return sum(map(_bulk_bytes, cast("dict[str, object]", value).values()))
    if not isinstance(value, msgspec.Struct):
        return 0
    bulk = 0
    for name in _bulky_fields(type(value)):
        bulk += _bulk_bytes(getattr(value, name))
    return bulk


@lru_cache(maxsize=512)
def _bulky_fields(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    """Fields that may hold arrays or byte strings; numbers and names, the most common types, are skipped."""
    return tuple(each.name for each in msgspec.structs.fields(kind) if each.type not in _PLAIN)


def decode(data: bytes, wanted: type[T]) -> T:
    """Decode a value of type `wanted`. Raises `CommunicationError` when `data` is anything else."""
    decoder, limit = _decoder(wanted)
    if len(data) > limit:
        raise CommunicationError(f"{_name(wanted)} of {len(data)} bytes refused; the longest allowed has {limit}")
    try:
        return decoder(data)
    except CommunicationError:
        raise
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
        raise CommunicationError(f"cannot decode {_name(wanted)}: {error}") from error


def _name(wanted: Any) -> str:
    return str(getattr(wanted, "__name__", wanted))


def from_plain(value: object, wanted: Any) -> Any:
    """Convert a JSON value to type `wanted`, lists to arrays. Raises `CommunicationError` when it does not fit."""
    try:
        return msgspec.convert(value, wanted, dec_hook=_array_of_list)
    except (msgspec.MsgspecError, ValueError, TypeError) as error:
        raise CommunicationError(str(error)) from error


def _array_of_list(wanted: Any, value: Any) -> Any:
    return np.array(value, dtype=_dtype_of(wanted))
