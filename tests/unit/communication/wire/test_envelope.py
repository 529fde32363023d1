import time

import pytest

from dlokit.communication.wire.envelope import Envelope, pack_envelope, this_machine, unpack_envelope
from dlokit.errors import SchemaMismatch

SCHEMA = b"01234567"
ELSEWHERE = this_machine() ^ 1


def test_an_envelope_tells_when_it_was_sealed() -> None:
    before_ns = time.monotonic_ns()
    envelope = unpack_envelope(pack_envelope(SCHEMA), SCHEMA)
    assert before_ns <= envelope.sent_ns <= time.monotonic_ns()
    assert envelope.sent_s(arrived_s=0.0) == envelope.sent_ns * 1e-9


def test_a_message_of_another_schema_is_refused_by_name() -> None:
    with pytest.raises(SchemaMismatch, match=r"3736353433323130.*3031323334353637.*run the same version"):
        unpack_envelope(pack_envelope(SCHEMA[::-1]), SCHEMA)


@pytest.mark.parametrize(
    "envelope", [None, b"", b"short", pack_envelope(SCHEMA) + b"!"], ids=["none", "empty", "short", "longer"]
)
def test_a_message_that_does_not_say_its_schema_is_refused(envelope: bytes | None) -> None:
    with pytest.raises(SchemaMismatch, match="no envelope"):
        unpack_envelope(envelope, SCHEMA)


def test_a_message_of_another_machine_is_as_old_as_its_stay_here() -> None:
    assert Envelope(SCHEMA, ELSEWHERE, 10**18).sent_s(arrived_s=3.0) == 3.0


def test_order_is_known_only_on_one_machine() -> None:
    early, late = Envelope(SCHEMA, this_machine(), 1), Envelope(SCHEMA, this_machine(), 2)
    assert early.is_not_newer_than(late)
    assert early.is_not_newer_than(early)
    assert not late.is_not_newer_than(early)
    assert not Envelope(SCHEMA, ELSEWHERE, 1).is_not_newer_than(late)
    assert not early.is_not_newer_than(None)
