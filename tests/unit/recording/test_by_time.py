"""The messages of a recording that are due at a time."""

from itertools import pairwise
from pathlib import Path

import pytest

from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.recording.reader import MessagesByTime, read_recording

REFERENCE = Path(__file__).parents[2] / "replay" / "references" / "wire.mcap"
WANTED = {topics.STATE.name, topics.FLOW.name, topics.TARGETS.name}


@pytest.fixture(scope="module")
def messages() -> MessagesByTime:
    return MessagesByTime(REFERENCE, WANTED, {topics.FLOW.name})


def test_until_the_end_every_status_and_the_last_of_all_else_is_due_in_order(messages: MessagesByTime) -> None:
    recorded = list(read_recording(REFERENCE, WANTED))
    due = messages.due(None, messages.last_ns)
    statuses = [one.log_ns for one in recorded if one.topic == topics.FLOW.name]
    assert [one.log_ns for one in due if one.topic == topics.FLOW.name] == statuses
    for name in (topics.STATE.name, topics.TARGETS.name):
        (only,) = (one for one in due if one.topic == name)
        assert only.log_ns == max(one.log_ns for one in recorded if one.topic == name)
    assert [one.log_ns for one in due] == sorted(one.log_ns for one in due)


def test_what_was_due_before_is_not_due_again(messages: MessagesByTime) -> None:
    half_ns = (messages.first_ns + messages.last_ns) // 2
    before, after = messages.due(None, half_ns), messages.due(half_ns, messages.last_ns)
    assert max(one.log_ns for one in before) <= half_ns < min(one.log_ns for one in after)
    statuses = [one for one in before + after if one.topic == topics.FLOW.name]
    assert len(statuses) == sum(1 for _ in messages.of(topics.FLOW.name))
    assert messages.due(messages.last_ns, messages.last_ns) == []


def test_messages_that_are_too_near_are_left_out(messages: MessagesByTime) -> None:
    times = [one.log_ns for one in messages.of(topics.STATE.name, min_gap_ns=500_000_000)]
    assert 1 < len(times) < sum(1 for _ in messages.of(topics.STATE.name))
    assert min(b - a for a, b in pairwise(times)) >= 500_000_000


def test_a_recording_without_these_channels_is_refused() -> None:
    with pytest.raises(InputError, match="contains nothing to show"):
        MessagesByTime(REFERENCE, {"robot/protection"}, set())
