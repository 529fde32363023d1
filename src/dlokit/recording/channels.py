"""Channels of a recording: the topics of the table and the skill calls, in addition to the views for Foxglove."""

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from dlokit.communication.topic import Every, Topic
from dlokit.communication.topics import DEPTH_IMAGES, STEREO_IMAGES, all_topics
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun, CallRecord

FILE_NAME = "recording.mcap"

CALLS_BEGUN = Topic("skill_calls_begun", CallBegun, "caller", None, Every(64), "start of each skill call")
SKILL_CALLS = Topic("skill_calls", CallRecord, "caller", None, Every(64), "end of each skill call")
CALLS = (CALLS_BEGUN, SKILL_CALLS)
"""Written by the callers; no component reads them."""

CLOCK = "clock"
"""Metadata of a recording: the run's clock `run_ns` and the wall clock `real_ns` at its first message [ns]."""


@cache
def recorded_topics() -> dict[str, Topic[Any]]:
    """Topics by channel name. The cell's true shape is on no topic, hence in no recording."""
    return {topic.name: topic for topic in (*all_topics(), *CALLS)}


IMAGE_FORMAT = "jpeg"
IMAGE_QUALITY = 90
DEPTH_FORMAT = "png"
"""Depths must not change: the format is lossless, in whole millimetres."""
IMAGES_PER_S = 2.0
"""Largest rate of recorded stereo pairs and depth images [1/s]; further images are only counted."""
PICTURE_ROWS = (STEREO_IMAGES.row, DEPTH_IMAGES.row)
"""Topics with pictures."""


def in_order(files: Iterable[Path]) -> list[Path]:
    """Files of a folder, sorted by the numbers in their names: ``colour_2.png`` before ``colour_10.png``."""
    parts = re.compile(r"(\D*)(\d*)").findall
    return sorted(sorted(files), key=lambda file: [(text, int(number or -1)) for text, number in parts(file.name)])


class ChannelsOf:
    """The channels of rows of the topic table, of every component instance; for `in`."""

    def __init__(self, rows: Iterable[str]) -> None:
        self._rows = frozenset(rows)

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in self._rows


def type_of(channel: str) -> type[Message] | None:
    """Message type of a channel; None for a view or a channel that this version does not have.

    Each instance of a topic has its own channel: `robot/state` and `robot/state/second`.
    """
    topic = topic_of(channel)
    return None if topic is None else topic.type


def topic_of(channel: str) -> Topic[Any] | None:
    """The topic of a channel, of any instance; None for a view or a channel that this version does not have."""
    recorded = recorded_topics()
    if channel in recorded:
        return recorded[channel]
    row, _, instance = channel.rpartition("/")
    return recorded[row].at(instance) if row in recorded else None
