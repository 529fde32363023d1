"""Messages to bytes and back: msgpack, with arrays as extension types.

Decoding executes nothing, checks every type, and allocates no more than it was sent. Arrays come back
read-only, because a message belongs to everybody.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.errors import CommunicationError

T = TypeVar("T")

ARRAY_CODE = 1
ALLOWED_DTYPES = frozenset({"<f8", "<f4", "|u1", "<i8", "|b1"})
LARGEST_RANK = 4


def _encode_hook(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"{type(value).__name__} cannot be sent; allowed: plain values, Structs, arrays")
    array: NDArray[Any] = np.ascontiguousarray(value)
    if array.dtype.str not in ALLOWED_DTYPES:
        raise CommunicationError(
            f"an array of {array.dtype} cannot be sent; allowed: {sorted(ALLOWED_DTYPES)}; convert it with .astype()"
        )
    head = msgspec.msgpack.encode((array.dtype.str, value.shape))
    return msgspec.msgpack.Ext(ARRAY_CODE, b"".join((len(head).to_bytes(2, "little"), head, array.tobytes())))


def _extension_hook(code: int, data: memoryview) -> NDArray[Any]:
    if code != ARRAY_CODE:
        raise CommunicationError(f"unknown extension type {code}; only {ARRAY_CODE} (array) is known")
    size = int.from_bytes(data[:2], "little")
    dtype, shape = msgspec.msgpack.decode(data[2 : 2 + size], type=tuple[str, tuple[int, ...]])
    if dtype not in ALLOWED_DTYPES or len(shape) > LARGEST_RANK or any(n < 0 for n in shape):
        raise CommunicationError(
            f"array of dtype {dtype!r} and shape {shape} refused; allowed: {sorted(ALLOWED_DTYPES)}"
        )
    body = bytes(data[2 + size :])
    expected = np.dtype(dtype).itemsize
    for extent in shape:
        expected *= extent
    if len(body) != expected:
        raise CommunicationError(f"array of shape {shape} needs {expected} bytes, {len(body)} came: message is cut")
    return np.frombuffer(body, dtype=dtype).reshape(shape)


def _decode_hook(wanted: Any, value: Any) -> Any:
    """Check that an array has the dtype that its annotation ``NDArray[dtype]`` names."""
    dtype = get_args(get_args(wanted)[1])[0]
    if not isinstance(value, np.ndarray) or value.dtype != np.dtype(dtype):
        found = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
        raise CommunicationError(f"array of {np.dtype(dtype)} expected, {found} came")
    return value


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encode_hook)


@lru_cache(maxsize=256)
def _decoder(wanted: Any) -> Callable[[bytes], Any]:
    return msgspec.msgpack.Decoder(wanted, ext_hook=_extension_hook, dec_hook=_decode_hook).decode


def encode(value: object) -> bytes:
    """Bytes of a value. Raises `CommunicationError` when something in it cannot be sent."""
    try:
        return _ENCODER.encode(value)
    except (NotImplementedError, TypeError, ValueError, msgspec.MsgspecError) as error:
        raise CommunicationError(f"cannot encode {type(value).__name__}: {error}") from error


def decode(data: bytes, wanted: type[T]) -> T:
    """The value of type `wanted` in `data`. Raises `CommunicationError` when it is anything else."""
    try:
        return _decoder(wanted)(data)
    except CommunicationError:
        raise
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
        raise CommunicationError(f"cannot decode {getattr(wanted, '__name__', wanted)}: {error}") from error


def from_plain(value: object, wanted: Any) -> Any:
    """A value of type `wanted` from what JSON has; arrays from lists. Raises `CommunicationError`."""
    try:
        return msgspec.convert(value, wanted, dec_hook=_array_of_list)
    except (msgspec.MsgspecError, ValueError, TypeError) as error:
        raise CommunicationError(str(error)) from error


def _array_of_list(wanted: Any, value: Any) -> Any:
    return np.array(value, dtype=get_args(get_args(wanted)[1])[0])
