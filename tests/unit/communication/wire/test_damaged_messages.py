"""For any input from the network, a decoder returns a value or raises `CommunicationError`."""

import time
import tracemalloc
from collections.abc import Callable
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_damage import mutated
from message_examples import example
from msgspec.structs import fields

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.topics import TOPICS
from dlokit.communication.wire import codec
from dlokit.communication.wire.codec import LARGEST_MESSAGE_BYTES
from dlokit.communication.wire.envelope import pack_envelope, unpack_envelope
from dlokit.communication.wire.schema import fingerprint
from dlokit.errors import CommunicationError
from dlokit.system.table import COMPONENTS
from dlokit.types.outcome import CallRecord

ALLOWED_BYTES = 2 * LARGEST_MESSAGE_BYTES  # the message itself, and its decoded arrays
ALLOWED_S = 5.0  # of processor time; a message takes microseconds
TYPES: dict[str, Any] = {topic.name: topic.type for topic in TOPICS} | {"record": CallRecord}
SCHEMA = fingerprint(CallRecord)

Decode = Callable[[bytes], object]
Sound = Callable[[Random], bytes]
every_time_the_same = settings(
    max_examples=40, deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)


def _encoded(wanted: Any) -> Sound:
    return lambda rng: codec.encode(example(wanted, rng))


def _of_type(wanted: Any) -> tuple[Decode, Sound]:
    return lambda data: codec.decode(data, wanted), _encoded(wanted)


def _of_skill(skill: Skill[..., Any]) -> dict[str, tuple[Decode, Sound]]:
    """Its decoders, each under the types that it decodes: one of several skills with the same types is enough."""
    arguments = ", ".join(str(field.type) for field in fields(skill.arguments_type))
    found: dict[str, tuple[Decode, Sound]] = {
        f"arguments: {arguments}": _of_type(skill.arguments_type),
        f"outcome: {skill.types['return']}": _of_type(skill.outcome_type),
    }
    if isinstance(skill, ReportingSkill):
        found[f"progress: {skill.reports}"] = (skill.decode_report, _encoded(skill.reports))
    return found


def _every_decoder() -> dict[str, tuple[Decode, Sound]]:
    found = {name: _of_type(wanted) for name, wanted in TYPES.items()}
    for component in COMPONENTS.values():
        for skill in component.skills():
            found |= _of_skill(skill)
    found["envelope"] = (lambda data: unpack_envelope(data, SCHEMA), lambda rng: pack_envelope(SCHEMA))
    return found


DECODERS = _every_decoder()
"""Every decoder of the bus by name, with a generator of valid messages."""
for_every_decoder = pytest.mark.parametrize(("decode", "sound"), DECODERS.values(), ids=DECODERS.keys())


def understood(decode: Decode, data: bytes) -> bool:
    """Decode a message within bounds of time and memory; False if it is refused. Other exceptions propagate."""
    tracemalloc.start()
    began_s = time.process_time()
    try:
        decode(data)
    except CommunicationError:
        return False
    finally:
        seconds, (_, asked_bytes) = time.process_time() - began_s, tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert seconds < ALLOWED_S
        assert asked_bytes < ALLOWED_BYTES
    return True


@for_every_decoder
@every_time_the_same
@given(seed=st.integers(0, 2**32 - 1))
def test_a_damaged_message_is_decoded_or_refused_within_bounds(decode: Decode, sound: Sound, seed: int) -> None:
    rng = Random(seed)  # hypothesis's own, which it could shrink, takes ten times as long
    understood(decode, mutated(sound(rng), rng))


@for_every_decoder
def test_a_valid_message_is_decoded(decode: Decode, sound: Sound) -> None:
    rng = Random(7)
    assert all(understood(decode, sound(rng)) for _ in range(5))


def test_some_damaged_messages_are_refused_and_some_decoded() -> None:
    # Otherwise the damage was absent, or too strong.
    rng = Random(1)
    found = [understood(decode, mutated(sound(rng), rng)) for decode, sound in DECODERS.values() for _ in range(10)]
    assert 0.0 < np.mean(found) < 0.9


def test_a_decoder_that_allocates_too_much_memory_is_detected() -> None:
    with pytest.raises(AssertionError):
        understood(lambda data: bytes(ALLOWED_BYTES + 1), b"")


@pytest.mark.parametrize("wanted", TYPES.values(), ids=TYPES.keys())
@every_time_the_same
@given(rng=st.randoms(use_true_random=False))
def test_every_message_is_decoded_as_sent(wanted: type[msgspec.Struct], rng: Random) -> None:
    sent = example(wanted, rng)
    assert_same(codec.decode(codec.encode(sent), wanted), sent)


def assert_same(one: object, other: object) -> None:
    assert type(one) is type(other)
    if isinstance(one, msgspec.Struct):
        for name in one.__struct_fields__:
            assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert one.tobytes() == other.tobytes()  # to the bit, also for NaN
    elif isinstance(one, tuple):
        assert isinstance(other, tuple)
        assert len(one) == len(other)
        for mine, theirs in zip(one, other, strict=True):
            assert_same(mine, theirs)
    else:
        assert repr(one) == repr(other)  # NaN is not equal to itself
