"""Feeds one component what it received in a recording, on virtual time, and keeps what it says and answers."""

import asyncio
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topic import Topic
from dlokit.errors import CommunicationError, InputError
from dlokit.recording.channels import CALLS_BEGUN, SKILL_CALLS, topic_of
from dlokit.recording.plain import from_json, from_plain
from dlokit.recording.reader import RawRecording, Recorded, read_recording
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun, CallEnd, CallRecord, Cancelled, Outcome


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


TURNS = 20
"""Turns of the event loop between two things that came at the same time: whoever got the first has dealt with it."""
LAST_WORDS_S = 1.0
"""What the component may still do after the last event."""


@dataclass(kw_only=True)
class Replayed:
    """What a component did when it was fed."""

    said: list[Heard] = field(default_factory=list[Heard])
    answers: list[tuple[Asked, Outcome[Any]]] = field(default_factory=list[tuple[Asked, Outcome[Any]]])
    """Every call with its outcome, in the order of their ends."""


def feed(
    component: Component,
    line: Timeline,
    said: Collection[Topic[Any]],
    instances: Mapping[str, tuple[str, ...]] | None = None,
) -> Replayed:
    """Run a component alone through the events of `line`, on virtual time that starts where the recording does.

    Kept is what it publishes on the topics `said`. `instances` names what there was more than one of, as `Container`
    wants it. Raises what the component's own loop raises.
    """
    return virtual_time.run(_feed(component, line, {topic.name for topic in said}, instances or {}))


async def _feed(
    component: Component, line: Timeline, kept: set[str], instances: Mapping[str, tuple[str, ...]]
) -> Replayed:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, virtual_time.VirtualTimeLoop)
    loop.advance(line.begin_ns / 1e9)
    replayed, clock = Replayed(), LoopClock()

    def keep(topic: Topic[Any], message: Message) -> None:
        if topic.row in kept:
            replayed.said.append(Heard(log_ns=clock.now_ns(), topic=topic, message=message))

    transport = MemoryTransport(keep)
    host = Container(transport, clock, instances=instances)
    host.add(component)
    calls: list[asyncio.Task[None]] = []
    async with host:
        fault = asyncio.create_task(host.wait_failed())
        feeding = asyncio.create_task(_feed_events(transport, clock, line.events, replayed, calls))
        try:
            await asyncio.wait({fault, feeding}, return_when=asyncio.FIRST_COMPLETED)
            (fault if fault.done() else feeding).result()
        finally:
            for task in (fault, feeding, *calls):
                task.cancel()
            await asyncio.gather(fault, feeding, *calls, return_exceptions=True)
    return replayed


async def _feed_events(
    transport: MemoryTransport,
    clock: LoopClock,
    events: Sequence[Heard | Asked],
    replayed: Replayed,
    calls: list["asyncio.Task[None]"],
) -> None:
    for event in events:
        await clock.sleep_until(event.log_ns)
        match event:
            case Heard():
                transport.publish(event.topic, event.message)
            case Asked():
                calls.append(asyncio.create_task(_ask(transport, clock, event, replayed), name=event.skill.key))
        for _ in range(TURNS):
            await asyncio.sleep(0)
    await clock.sleep(LAST_WORDS_S)


async def _ask(transport: MemoryTransport, clock: LoopClock, asked: Asked, replayed: Replayed) -> None:
    """Call as was called; who gave up then gives up at the same time now."""
    call = asyncio.create_task(transport.call(asked.skill, **asked.arguments))
    if asked.answer.outcome is CallEnd.CANCELLED:
        await clock.sleep_until(asked.answer.stamp_ns)
        call.cancel()
    try:
        outcome: Outcome[Any] = await call
    except asyncio.CancelledError:
        current = asyncio.current_task()
        if current is not None and current.cancelling():
            call.cancel()
            raise
        outcome = Cancelled()
    replayed.answers.append((asked, outcome))
