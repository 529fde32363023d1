"""What a recording holds: the topics of the table, the skill calls, and nothing else but views of these."""

from typing import Any

from dlokit.communication.topic import Every, Topic
from dlokit.communication.topics import TOPICS
from dlokit.types.message import Message
from dlokit.types.skill_call import CallRecord

FILE_NAME = "recording.mcap"

SKILL_CALLS = Topic("skill_calls", CallRecord, "recorder", None, Every(64), "skill calls that have ended")
"""Not on the bus: whoever calls hands it to the recorder."""

RECORDED: dict[str, Topic[Any]] = {topic.name: topic for topic in (*TOPICS, SKILL_CALLS)}
"""By channel. The cell's true shape is on no topic, and so in no recording."""

IMAGE_FORMAT = "jpeg"
IMAGE_QUALITY = 90
IMAGES_PER_S = 2.0
"""Pairs of pictures that are kept, at most; the others are counted."""


def type_of(channel: str) -> type[Message] | None:
    """What a channel holds; None for a view or a channel that this version does not know.

    A topic of which there is more than one has a channel for each: `robot/state` and `robot/state/opposite`.
    """
    row = RECORDED.get(channel) or RECORDED.get(channel.rpartition("/")[0])
    return None if row is None else row.type
