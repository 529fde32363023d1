"""What a recording holds: the topics of the table, the skill calls, and nothing else but views of these."""

from typing import Any

from dlokit.communication.topic import Every, Topic
from dlokit.communication.topics import TOPICS
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun, CallRecord

FILE_NAME = "recording.mcap"

CALLS_BEGUN = Topic("skill_calls_begun", CallBegun, "caller", None, Every(64), "skill calls that were made")
SKILL_CALLS = Topic("skill_calls", CallRecord, "caller", None, Every(64), "skill calls that have ended")
CALLS = (CALLS_BEGUN, SKILL_CALLS)
"""Whoever calls tells of it; no component reads them."""

RECORDED: dict[str, Topic[Any]] = {topic.name: topic for topic in (*TOPICS, *CALLS)}
"""By channel. The cell's true shape is on no topic, and so in no recording."""

IMAGE_FORMAT = "jpeg"
IMAGE_QUALITY = 90
IMAGES_PER_S = 2.0
"""Pairs of pictures that are kept, at most; the others are counted."""


def type_of(channel: str) -> type[Message] | None:
    """What a channel holds; None for a view or a channel that this version does not know.

    A topic of which there is more than one has a channel for each: `robot/state` and `robot/state/opposite`.
    """
    topic = topic_of(channel)
    return None if topic is None else topic.type


def topic_of(channel: str) -> Topic[Any] | None:
    """The topic of a channel, whosever it is; None for a view or a channel that this version does not know."""
    if channel in RECORDED:
        return RECORDED[channel]
    row, _, instance = channel.rpartition("/")
    return RECORDED[row].at(instance) if row in RECORDED else None
