"""Replay of one component: feed it its recorded inputs on virtual time, and collect its messages and answers."""

import asyncio
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dlokit.communication.component import Component
from dlokit.communication.container import Container, end_tasks
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topic import Topic
from dlokit.communication.topics import CAMERA, OBSERVATION
from dlokit.errors import CommunicationError, InputError
from dlokit.recording.channels import CALLS_BEGUN, SKILL_CALLS, ChannelsOf, topic_of
from dlokit.recording.message_json import from_json, from_plain
from dlokit.recording.reader import RawRecording, Recorded, read_recording
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.message import Message
from dlokit.types.observation import CameraView, Observation
from dlokit.types.outcome import CallBegun, CallEnd, CallRecord, Cancelled, Outcome


@dataclass(frozen=True, kw_only=True)
class TimedMessage:
    """A message that the component received or published, with its time."""

    log_ns: int
    topic: Topic[Any]
    message: Message


@dataclass(frozen=True, kw_only=True)
class RecordedCall:
    """A recorded call of one of the component's skills."""

    log_ns: int
    """Time of the call [ns]."""
    skill: Skill[..., Any]
    arguments: Mapping[str, Any]
    answer: CallRecord
    """The outcome, stamped with the end of the call."""


@dataclass(kw_only=True)
class Timeline:
    """Inputs and outputs of one component, in the order of the recording."""

    events: list[TimedMessage | RecordedCall] = field(default_factory=list[TimedMessage | RecordedCall])
    """Messages that it received and calls of its skills."""
    published: list[TimedMessage] = field(default_factory=list[TimedMessage])
    begin_ns: int = 0
    """Start of the recording [ns]."""
    unknown: int = 0
    """Number of calls that cannot be replayed: the arguments were too long to record, or the end is not in the file."""


def read_timeline(path: Path, component: type[Component], published: Collection[Topic[Any]]) -> Timeline:
    """Read the inputs of a component class, and its messages on the topics `published`, of all instances.

    Raises `InputError` and `SchemaMismatch` as `read_recording` does.
    """
    input_rows = {topic.name for topic in component.subscribes()}
    output_rows = {topic.name for topic in published}
    rows = input_rows | output_rows | {CALLS_BEGUN.name, SKILL_CALLS.name}
    messages = list(read_recording(path, ChannelsOf(rows)))
    if CAMERA.name in rows and not any(one.topic == CAMERA.name for one in messages):
        messages = sorted((*messages, *_cameras_of_clouds(path)), key=lambda one: one.log_ns)
    calls, unknown = _calls_of(component, messages)
    line = Timeline(unknown=unknown, begin_ns=next((record.log_time for _, record in RawRecording(path=path)), 0))
    for one in messages:
        topic = topic_of(one.topic)
        assert topic is not None, f"{one.topic} was read, so it is known"
        if topic.row in output_rows:
            line.published.append(TimedMessage(log_ns=one.log_ns, topic=topic, message=one.message))
        elif topic.row in input_rows:
            line.events.append(TimedMessage(log_ns=one.log_ns, topic=topic, message=one.message))
        elif isinstance(one.message, CallBegun) and (key := (one.message.caller, one.message.call)) in calls:
            line.events.append(calls[key])
    _move_behind_priors(line)
    return line


def _move_behind_priors(line: Timeline) -> None:
    """Move each cloud to where the newest state is the one that was the prior of its targets.

    In a live run state and cloud may have reached the observer in another order than the recorder.
    """
    targets = (one.message for one in line.published if isinstance(one.message, TargetPoints))
    priors = {one.stamp_ns: one.prior_stamp_ns for one in targets if one.prior_stamp_ns}
    states = {
        event.message.stamp_ns: place
        for place, event in enumerate(line.events)
        if isinstance(event, TimedMessage) and isinstance(event.message, DloState)
    }
    places: list[tuple[int, bool]] = []
    newest = None
    for place, event in enumerate(line.events):
        message = event.message if isinstance(event, TimedMessage) else None
        newest = states[message.stamp_ns] if isinstance(message, DloState) else newest
        prior = states.get(priors.get(message.stamp_ns, -1)) if isinstance(message, Observation) else None
        places.append((place, False) if prior is None or prior == newest else (prior, True))
    line.events = [line.events[i] for i in sorted(range(len(places)), key=places.__getitem__)]


def _cameras_of_clouds(path: Path) -> Iterable[Recorded]:
    """The camera of each look, from a recording in which only the clouds contain it."""
    for one in read_recording(path, ChannelsOf({OBSERVATION.name})):
        if isinstance(one.message, Observation) and one.message.calibration is not None:
            view = CameraView(stamp_ns=one.message.stamp_ns, calibration=one.message.calibration)
            yield replace(one, topic=CAMERA.name, message=view)


def _calls_of(
    component: type[Component], messages: Iterable[Recorded]
) -> tuple[dict[tuple[str, int], RecordedCall], int]:
    """The calls of a component by caller and number, and the number of calls that are not recorded completely."""
    skills = {skill.key: skill for skill in component.skills()}
    calls: dict[tuple[str, int], RecordedCall] = {}
    begun = 0
    for one in messages:
        match one.message:
            case CallBegun(skill=key) if key in skills:
                begun += 1
            case CallRecord(skill=key, arguments=text) as record if key in skills and text:
                calls[record.caller, record.call] = _recorded_call(skills[key], record)
            case _:
                pass
    return calls, begun - len(calls)


_RENAMED = {"missed_m": "prediction_error_m"}
"""Arguments of skills in recordings of earlier versions → their present names."""


def _recorded_call(skill: Skill[..., Any], record: CallRecord) -> RecordedCall:
    try:
        plain = from_json(record.arguments.encode(), dict[str, Any])
        named = {_RENAMED.get(name, name): value for name, value in plain.items()}
        arguments = {name: from_plain(value, skill.types[name]) for name, value in named.items()}
    except (CommunicationError, KeyError) as error:
        raise InputError(
            f"a recorded call of {skill.key} does not fit the skill of this version ({error}); replay the recording "
            f"with the version that wrote it, which dlokit info shows."
        ) from error
    return RecordedCall(log_ns=record.began_ns, skill=skill, arguments=arguments, answer=record)


TURNS = 20
"""Turns of the event loop between two events of the same time, so that the component has processed the first."""
RUN_ON_S = 1.0
"""Time for which the component runs after the last event [s]."""


@dataclass(kw_only=True)
class ReplayResult:
    """Messages and answers of a replayed component."""

    published: list[TimedMessage] = field(default_factory=list[TimedMessage])
    answers: list[tuple[RecordedCall, Outcome[Any]]] = field(default_factory=list[tuple[RecordedCall, Outcome[Any]]])
    """Each call with its outcome, in the order of their ends."""


def feed(
    component: Component,
    line: Timeline,
    published: Collection[Topic[Any]],
    instances: Mapping[str, tuple[str, ...]] | None = None,
) -> ReplayResult:
    """Run a component alone with the events of `line` as input, on virtual time that starts with the recording.

    The result contains its messages on the topics `published`. `instances` is as in `Container`. Raises the errors of
    the component's own tasks.
    """
    return virtual_time.run(_feed(component, line, {topic.name for topic in published}, instances or {}))


async def _feed(
    component: Component, line: Timeline, kept: set[str], instances: Mapping[str, tuple[str, ...]]
) -> ReplayResult:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, virtual_time.VirtualTimeLoop)
    loop.advance(line.begin_ns / 1e9)
    replayed, clock = ReplayResult(), LoopClock()

    def keep(topic: Topic[Any], message: Message) -> None:
        if topic.row in kept:
            replayed.published.append(TimedMessage(log_ns=clock.now_ns(), topic=topic, message=message))

    transport = MemoryTransport(keep)
    container = Container(transport, clock, instances=instances)
    container.add(component)
    calls: list[asyncio.Task[None]] = []
    async with container, container.guarded():
        try:
            await _feed_events(transport, clock, line.events, replayed, calls)
        finally:
            await end_tasks(*calls)
    return replayed


async def _feed_events(
    transport: MemoryTransport,
    clock: LoopClock,
    events: Sequence[TimedMessage | RecordedCall],
    replayed: ReplayResult,
    calls: list["asyncio.Task[None]"],
) -> None:
    for event in events:
        await clock.sleep_until(event.log_ns)
        match event:
            case TimedMessage():
                transport.publish(event.topic, event.message)
            case RecordedCall():
                calls.append(asyncio.create_task(_call(transport, clock, event, replayed), name=event.skill.key))
        for _ in range(TURNS):
            await asyncio.sleep(0)
    await clock.sleep(RUN_ON_S)


async def _call(transport: MemoryTransport, clock: LoopClock, recorded: RecordedCall, replayed: ReplayResult) -> None:
    """Repeat a recorded call; if it was cancelled, cancel it at the same time."""
    call = asyncio.create_task(transport.call(recorded.skill, **recorded.arguments))
    if recorded.answer.outcome is CallEnd.CANCELLED:
        await clock.sleep_until(recorded.answer.stamp_ns)
        call.cancel()
    try:
        outcome: Outcome[Any] = await call
    except asyncio.CancelledError:
        current = asyncio.current_task()
        if current is not None and current.cancelling():
            call.cancel()
            raise
        outcome = Cancelled()
    replayed.answers.append((recorded, outcome))
