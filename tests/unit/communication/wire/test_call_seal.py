"""What goes beside a call and its answers."""

import pytest

from dlokit.communication.wire.envelope import AnswerKind, label_of, mark_of, read_label, read_mark


def test_a_label_tells_the_number_of_a_call_and_whether_the_call_is_as_it_was_sent() -> None:
    label = read_label(label_of("caller-7", b"request"))
    assert label.call_id == "caller-7"
    assert label.fits(b"request")
    assert not label.fits(b"requesT")


@pytest.mark.parametrize("kind", list(AnswerKind))
def test_a_mark_tells_the_kind_of_an_answer(kind: AnswerKind) -> None:
    assert read_mark(mark_of(kind, b"answer"), b"answer") is kind


def test_an_outcome_that_was_altered_is_asked_for_again_and_progress_is_not() -> None:
    assert read_mark(mark_of(AnswerKind.OUTCOME, b"answer"), b"Answer") is AnswerKind.ALTERED
    assert read_mark(mark_of(AnswerKind.PROGRESS, b"answer"), b"Answer") is None


@pytest.mark.parametrize("data", [b"", b"abc", b"abcdx", b"abcdop"])
def test_what_nobody_can_have_sent_is_no_answer(data: bytes) -> None:
    assert read_mark(data, b"answer") is None
