from random import Random

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dlokit.bench.fuzz.campaign import ALLOWED_BYTES, fuzz
from dlokit.bench.fuzz.decoders import Decoder, all_decoders
from dlokit.bench.fuzz.examples import example
from dlokit.communication.skill import SkillCall
from dlokit.communication.topics import TOPICS
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.outcome import CallRecord

DECODERS = all_decoders()
TYPES = {topic.name: topic.type for topic in TOPICS} | {"call": SkillCall, "record": CallRecord}
COUNT = 5_000  # a second; `dlokit bench fuzz` sends a million


def assert_same(one: object, other: object) -> None:
    assert type(one) is type(other)
    if isinstance(one, msgspec.Struct):
        for name in one.__struct_fields__:
            assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert one.tobytes() == other.tobytes()  # to the bit: NaN as well
    elif isinstance(one, tuple):
        assert isinstance(other, tuple)
        assert len(one) == len(other)
        for mine, theirs in zip(one, other, strict=True):
            assert_same(mine, theirs)
    else:
        assert repr(one) == repr(other)  # NaN is not equal to itself


@pytest.mark.parametrize("wanted", TYPES.values(), ids=TYPES.keys())
@settings(max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow])
@given(rng=st.randoms(use_true_random=False))
def test_every_message_comes_back_as_it_was_sent(wanted: type[msgspec.Struct], rng: Random) -> None:
    sent = example(wanted, rng)
    assert_same(codec.decode(codec.encode(sent), wanted), sent)


@pytest.mark.parametrize("decoder", DECODERS, ids=[decoder.name for decoder in DECODERS])
def test_every_decoder_understands_what_is_sound(decoder: Decoder) -> None:
    rng = Random(7)
    for _ in range(5):
        decoder.decode(decoder.sound(rng))


def test_damaged_messages_crash_no_decoder_hang_none_and_ask_for_little() -> None:
    result = fuzz(DECODERS, COUNT, seed=1)
    assert result.messages == COUNT
    assert not result.wrong
    assert 0 < result.refused < COUNT  # else nothing was damaged, or everything beyond recognition


def _refuses(data: bytes) -> object:
    raise CommunicationError("as it should")


def _crashes(data: bytes) -> object:
    return data[10_000]


def _asks(data: bytes) -> object:
    return bytes(ALLOWED_BYTES + 1)


@pytest.mark.parametrize(("decode", "problem"), [(_refuses, None), (_crashes, "IndexError"), (_asks, "asked for 134")])
def test_a_decoder_that_does_not_keep_to_its_promise_is_found(decode: object, problem: str | None) -> None:
    assert callable(decode)
    result = fuzz([Decoder("guilty", decode, lambda rng: b"sound")], 3, seed=1)
    assert len(result.wrong) == (0 if problem is None else 3)
    assert all(problem in wrong for wrong in result.wrong if problem is not None)
