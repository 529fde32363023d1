"""Feeds one component what it received in a recording, on virtual time, and keeps what it says and answers."""

import asyncio
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dlokit.communication import virtual_time
from dlokit.communication.clock import LoopClock
from dlokit.communication.component import Component
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.recording.timeline import Asked, Heard, Timeline
from dlokit.communication.topic import Topic
from dlokit.types.message import Message
from dlokit.types.outcome import Cancelled, Outcome
from dlokit.types.skill_call import CallEnd

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

    Kept is what it publishes on the topics `said`. `instances` names what there was more than one of, as `Host` wants
    it. Raises what the component's own loop raises.
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
    host = Host(transport, clock, instances=instances)
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
