import tracemalloc
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.communication.wire import codec
from dlokit.communication.wire.codec import (
    ALLOWED_DTYPES,
    ARRAY_CODE,
    LARGEST_LISTING_BYTES,
    LARGEST_MESSAGE_BYTES,
    LARGEST_RANK,
)
from dlokit.errors import CommunicationError
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array
from dlokit.types.message import Message, Value
from dlokit.types.outcome import CallRecord
from dlokit.types.pose import Pose


class Everything(Message, frozen=True, kw_only=True, eq=False):
    float64: Float64Array
    float32: Float32Array
    uint8: UInt8Array
    int64: Int64Array
    bool_: BoolArray
    absent: Float64Array | None = None
    poses: tuple[Pose, ...] = ()


class Vector(Value, frozen=True, kw_only=True, eq=False):
    values: Float64Array


class Named(Value, frozen=True, kw_only=True, eq=False):
    name: str
    values: Float64Array


class Flags(Value, frozen=True, kw_only=True, eq=False):
    values: BoolArray


class Pair(Value, frozen=True, kw_only=True, eq=False):
    value: float
    count: int


def random_message(rng: np.random.Generator) -> Everything:
    def shape() -> tuple[int, ...]:
        return tuple(rng.integers(0, 5, size=rng.integers(0, LARGEST_RANK + 1)))

    def pose() -> Pose:
        return geometry.pose(rng.normal(size=3), rng.normal(size=4))

    return Everything(
        stamp_ns=int(rng.integers(2**62)),
        float64=np.array(rng.normal(size=shape())),
        float32=np.array(rng.normal(size=shape()), dtype=np.float32),
        uint8=np.array(rng.integers(0, 256, size=shape()), dtype=np.uint8),
        int64=np.array(rng.integers(-(2**62), 2**62, size=shape())),
        bool_=np.array(rng.integers(0, 2, size=shape()), dtype=np.bool_),
        absent=rng.normal(size=(2, 3)) if rng.random() < 0.5 else None,
        poses=tuple(pose() for _ in range(rng.integers(3))),
    )


def assert_same(one: msgspec.Struct, other: msgspec.Struct) -> None:
    for name in one.__struct_fields__:
        mine, theirs = getattr(one, name), getattr(other, name)
        if isinstance(mine, np.ndarray):
            assert mine.dtype == theirs.dtype
            assert mine.shape == theirs.shape
            np.testing.assert_array_equal(mine, theirs)
        elif isinstance(mine, tuple):
            assert len(mine) == len(theirs)
            for each, its_copy in zip(mine, theirs, strict=True):
                assert_same(each, its_copy)
        else:
            assert mine == theirs


def many_messages(count: int) -> Callable[[Callable[[int], None]], Callable[[], None]]:
    """Calls a test with as many seeds of messages, always the same ones; a failure names its seed."""
    each_time_the_same = settings(max_examples=count, deadline=None, derandomize=True, database=None)
    return lambda test: each_time_the_same(given(seed=st.integers(0, 2**32 - 1))(test))


@many_messages(20)
def test_decoding_restores_an_encoded_value(seed: int) -> None:
    message = random_message(np.random.default_rng(seed))
    assert_same(message, codec.decode(codec.encode(message), Everything))


@pytest.mark.parametrize("seed", range(3))
def test_a_message_that_is_cut_anywhere_is_refused(seed: int) -> None:
    data = codec.encode(random_message(np.random.default_rng(seed)))
    for length in range(len(data)):
        with pytest.raises(CommunicationError):
            codec.decode(data[:length], Everything)


@many_messages(200)
def test_a_damaged_message_is_refused_or_decoded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(codec.encode(random_message(rng)))
    for _ in range(rng.integers(1, 4)):
        data[rng.integers(len(data))] = rng.integers(256)
    try:
        decoded = codec.decode(bytes(data), Everything)
    except CommunicationError:
        return
    assert isinstance(decoded, Everything)


def test_arrays_of_a_message_are_read_only() -> None:
    decoded = codec.decode(codec.encode(Vector(values=np.zeros(3))), Vector)
    with pytest.raises(ValueError, match="read-only"):
        decoded.values[0] = 1.0


@pytest.mark.parametrize("count", [10, 100_000], ids=["copied", "view of what came"])
def test_small_and_large_arrays_come_back_the_same_and_aligned(count: int) -> None:
    for offset in range(8):  # the offset of an array in a message depends on the data before it
        message = Named(name="n" * offset, values=np.arange(count, dtype=np.float64))
        buffer = bytearray()
        codec.encode_into(message, buffer)
        assert bytes(buffer) == codec.encode(message)
        decoded = codec.decode(bytes(buffer), Named)
        np.testing.assert_array_equal(decoded.values, message.values)
        assert decoded.values.flags.aligned
        assert not decoded.values.flags.writeable


def test_a_reused_buffer_has_only_the_new_message() -> None:
    buffer = bytearray()
    codec.encode_into(Vector(values=np.zeros(1000)), buffer)
    codec.encode_into(Vector(values=np.ones(2)), buffer)
    np.testing.assert_array_equal(codec.decode(bytes(buffer), Vector).values, [1.0, 1.0])


def test_a_message_that_is_too_long_is_refused_before_decoding() -> None:
    with pytest.raises(CommunicationError, match=r"Vector of 67108865 bytes refused; .* 67108864"):
        codec.decode(bytes(LARGEST_MESSAGE_BYTES + 1), Vector)


def test_a_type_with_any_number_of_items_has_a_smaller_limit() -> None:
    listing = tuple[float, ...]
    with pytest.raises(CommunicationError, match="refused; the longest allowed has 2097152"):
        codec.decode(bytes(LARGEST_LISTING_BYTES + 1), listing)


class Floats(Value, frozen=True, kw_only=True, eq=False):
    items: tuple[float, ...]


class Texts(Value, frozen=True, kw_only=True, eq=False):
    items: tuple[str, ...]


class Vectors(Value, frozen=True, kw_only=True, eq=False):
    items: tuple[Vector, ...]


@pytest.mark.parametrize(
    ("wanted", "item"),
    [
        (Floats, b"\x01"),
        (Texts, b"\xa1a"),
        (Vectors, msgspec.msgpack.encode({"values": np.zeros(0)}, enc_hook=codec._encode_hook)),  # pyright: ignore[reportPrivateUsage]
    ],
    ids=["floats", "texts", "arrays"],
)
def test_the_longest_list_takes_less_than_twice_the_longest_message(wanted: type[Value], item: bytes) -> None:
    count = 200_000 // len(item)
    data = b"\x81\xa5items\xdd" + count.to_bytes(4, "big") + item * count
    tracemalloc.start()
    try:
        codec.decode(data, wanted)
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak_bytes / len(data) * codec.largest_bytes(wanted) < 2 * LARGEST_MESSAGE_BYTES


def test_a_bool_that_is_neither_true_nor_false_is_refused() -> None:
    # NumPy relies on it: other values let nonzero() write beyond its allocated memory.
    data = msgspec.msgpack.encode({"values": array_extension("|b1", (2,), b"\x01\x02")})
    with pytest.raises(CommunicationError, match="other than 0 and 1"):
        codec.decode(data, Flags)


def test_a_transposed_view_keeps_its_values() -> None:
    view = np.arange(6.0).reshape(2, 3).T
    np.testing.assert_array_equal(codec.decode(codec.encode(Vector(values=view)), Vector).values, view)


def test_an_array_of_another_dtype_than_declared_is_refused() -> None:
    wrong = msgspec.msgpack.encode({"values": array_extension("<f4", (1,), b"\0\0\0\0")})
    with pytest.raises(CommunicationError, match=r"array of float64.*float32"):
        codec.decode(wrong, Vector)


def test_a_list_in_the_place_of_an_array_is_refused() -> None:
    with pytest.raises(CommunicationError, match=r"array of float64.*list"):
        codec.decode(msgspec.msgpack.encode({"values": [1.0]}), Vector)


@pytest.mark.parametrize("dtype", ["O", "|O", "<U4", "<f2", ">f8", "V8", "<c16", "<M8[ns]"])
def test_a_received_array_of_a_forbidden_dtype_is_refused(dtype: str) -> None:
    with pytest.raises(CommunicationError, match="refused; allowed"):
        codec.decode(msgspec.msgpack.encode({"values": array_extension(dtype, (1,), b"\0" * 8)}), Vector)


@pytest.mark.parametrize(
    "array",
    [np.zeros(1, dtype=np.float16), np.array([object()]), np.array(["text"]), np.zeros(1, dtype=">f8")],
    ids=lambda array: str(array.dtype),
)
def test_an_array_of_a_forbidden_dtype_is_not_sent(array: NDArray[np.generic]) -> None:
    assert array.dtype.str not in ALLOWED_DTYPES
    with pytest.raises(CommunicationError, match="cannot be sent; allowed"):
        codec.encode([array])


@pytest.mark.parametrize(
    ("shape", "body"),
    [
        ((2**62, 4), b""),
        ((2**31, 2**31, 2**31, 2), b"\0" * 8),
        ((-1,), b""),
        ((-1, -8), b"\0" * 64),
        ((1,) * 5, b"\0" * 8),
    ],
    ids=["huge", "overflowing", "negative", "twice negative", "too many axes"],
)
def test_a_shape_that_does_not_fit_the_bytes_is_refused_before_anything_is_allocated(
    shape: tuple[int, ...], body: bytes
) -> None:
    with pytest.raises(CommunicationError):
        codec.decode(msgspec.msgpack.encode({"values": array_extension("<f8", shape, body)}), Vector)


def test_an_unknown_extension_is_refused() -> None:
    data = msgspec.msgpack.encode({"values": msgspec.msgpack.Ext(ARRAY_CODE + 1, b"cos\nsystem\n")})
    with pytest.raises(CommunicationError, match="unknown extension type"):
        codec.decode(data, Vector)


def test_unknown_fields_and_wrong_types_are_refused_by_name() -> None:
    with pytest.raises(CommunicationError, match="unknown field `extra`"):
        codec.decode(msgspec.msgpack.encode({"value": 1.0, "count": 1, "extra": 0}), Pair)
    with pytest.raises(CommunicationError, match=r"Expected `int`, got `str` - at `\$.count`"):
        codec.decode(msgspec.msgpack.encode({"value": 1.0, "count": "1"}), Pair)


def test_nesting_deeper_than_any_message_is_refused_and_not_a_crash() -> None:
    with pytest.raises(CommunicationError):
        codec.decode(b"\x81\xa1x" + b"\x91" * 200_000, CallRecord)


def test_a_value_that_cannot_be_sent_is_named() -> None:
    with pytest.raises(CommunicationError, match="object cannot be sent"):
        codec.encode([object()])


def test_numpy_scalars_are_sent_as_numbers() -> None:
    data = codec.encode({"value": np.float64(1.5), "count": np.int64(2)})
    assert msgspec.msgpack.decode(data) == {"value": 1.5, "count": 2}


def array_extension(dtype: str, shape: tuple[int, ...], body: bytes) -> msgspec.msgpack.Ext:
    head = msgspec.msgpack.encode((dtype, shape))
    return msgspec.msgpack.Ext(ARRAY_CODE, len(head).to_bytes(2, "little") + head + body)
