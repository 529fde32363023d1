"""A recording as one component lived it: what it heard, what it was asked, and what it said."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dlokit.communication.component import Component
from dlokit.communication.recording.channels import CALLS_BEGUN, SKILL_CALLS, topic_of
from dlokit.communication.recording.plain import from_json, from_plain
from dlokit.communication.recording.reader import RawRecording, Recorded, read_recording
from dlokit.communication.skill import Skill
from dlokit.communication.topic import Topic
from dlokit.errors import CommunicationError, InputError
from dlokit.types.message import Message
from dlokit.types.skill_call import CallBegun, CallRecord


@dataclass(frozen=True, kw_only=True)
class Heard:
    """A message that came to the component."""

    log_ns: int
    topic: Topic[Any]
    message: Message


@dataclass(frozen=True, kw_only=True)
class Asked:
    """A call of one of the component's skills."""

    log_ns: int
    """When it was called."""
    skill: Skill[..., Any]
    arguments: Mapping[str, Any]
    answer: CallRecord
    """How it ended, at its stamp."""


@dataclass(kw_only=True)
class Timeline:
    """Everything of one component, in the order of the recording."""

    events: list[Heard | Asked] = field(default_factory=list[Heard | Asked])
    said: list[Heard] = field(default_factory=list[Heard])
    """What it published."""
    begin_ns: int = 0
    """When the recording begins."""
    unknown: int = 0
    """Calls whose arguments were too long to be recorded, or whose end is not in the file: they are not made."""


def read_timeline(path: Path, component: type[Component], said: Collection[Topic[Any]]) -> Timeline:
    """What a component of that class heard, was asked, and, of the topics `said`, published, whosever they are.

    Raises `InputError` and `SchemaMismatch` as `read_recording` does.
    """
    heard = {topic.name for topic in component.subscribes()}
    said_rows = {topic.name for topic in said}
    messages = list(read_recording(path, _Wanted(heard | said_rows | {CALLS_BEGUN.name, SKILL_CALLS.name})))
    calls = _Calls(component, messages)
    line = Timeline(unknown=calls.unknown, begin_ns=_begin_ns(path))
    for one in messages:
        topic = topic_of(one.topic)
        assert topic is not None, f"{one.topic} was read, so it is known"
        if topic.row in said_rows:
            line.said.append(Heard(log_ns=one.log_ns, topic=topic, message=one.message))
        elif topic.row in heard:
            line.events.append(Heard(log_ns=one.log_ns, topic=topic, message=one.message))
        elif isinstance(one.message, CallBegun) and (asked := calls.begun(one.message)) is not None:
            line.events.append(asked)
    return line


def _begin_ns(path: Path) -> int:
    return next((record.log_time for _, record in RawRecording(path=path)), 0)


class _Wanted:
    """Topics by row, whosever they are."""

    def __init__(self, rows: set[str]) -> None:
        self._rows = rows

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in self._rows


class _Calls:
    """The calls of a component by their number, as they ended."""

    def __init__(self, component: type[Component], messages: Iterable[Recorded]) -> None:
        skills = {skill.key: skill for skill in component.skills()}
        self._asked: dict[tuple[str, int], Asked] = {}
        self.unknown = 0
        begun = 0
        for one in messages:
            match one.message:
                case CallBegun(skill=key) if key in skills:
                    begun += 1
                case CallRecord(skill=key, arguments=text) as record if key in skills and text:
                    self._asked[record.caller, record.call] = _asked(skills[key], record)
                case _:
                    pass
        self.unknown = begun - len(self._asked)

    def begun(self, message: CallBegun) -> Asked | None:
        """The call that began, when it is the component's and all of it is known."""
        return self._asked.get((message.caller, message.call))


def _asked(skill: Skill[..., Any], record: CallRecord) -> Asked:
    try:
        plain = from_json(record.arguments.encode(), dict[str, Any])
        arguments = {name: from_plain(value, skill.types[name]) for name, value in plain.items()}
    except (CommunicationError, KeyError) as error:
        raise InputError(
            f"a recorded call of {skill.key} does not fit the skill of this version ({error}); replay the recording "
            f"with the version that made it, which dlokit info names."
        ) from error
    return Asked(log_ns=record.began_ns, skill=skill, arguments=arguments, answer=record)
