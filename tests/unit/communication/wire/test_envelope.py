import time

import pytest

from dlokit.communication.wire.envelope import Envelope, opened, seal, this_machine
from dlokit.errors import SchemaMismatch

SCHEMA = b"01234567"
ELSEWHERE = this_machine() ^ 1


def test_an_envelope_tells_when_it_was_sealed() -> None:
    before_ns = time.monotonic_ns()
    envelope = opened(seal(SCHEMA), SCHEMA)
    assert before_ns <= envelope.sent_ns <= time.monotonic_ns()
    assert envelope.sent_s(arrived_s=0.0) == envelope.sent_ns * 1e-9


def test_a_message_of_another_schema_is_refused_by_name() -> None:
    with pytest.raises(SchemaMismatch, match="3736353433323130 there, 3031323334353637 here; run the same version"):
        opened(seal(SCHEMA[::-1]), SCHEMA)


@pytest.mark.parametrize(
    "envelope", [None, b"", b"short", seal(SCHEMA) + b"!"], ids=["none", "empty", "short", "longer"]
)
def test_a_message_that_does_not_say_its_schema_is_refused(envelope: bytes | None) -> None:
    with pytest.raises(SchemaMismatch, match="does not say in which schema"):
        opened(envelope, SCHEMA)


def test_a_message_of_another_machine_is_as_old_as_its_stay_here() -> None:
    assert Envelope(SCHEMA, ELSEWHERE, 10**18).sent_s(arrived_s=3.0) == 3.0


def test_order_is_known_only_on_one_machine() -> None:
    early, late = Envelope(SCHEMA, this_machine(), 1), Envelope(SCHEMA, this_machine(), 2)
    assert early.not_after(late)
    assert early.not_after(early)
    assert not late.not_after(early)
    assert not Envelope(SCHEMA, ELSEWHERE, 1).not_after(late)
    assert not early.not_after(None)
