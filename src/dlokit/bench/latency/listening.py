"""Listens on the bus of a running system, as a viewer does, and notes when each message was sent."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from dlokit.bench.latency.hops import CLOUD, PICTURES, STATE, TARGETS, Sent
from dlokit.communication import topics
from dlokit.communication.topic import Topic
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.types.message import Message

T = TypeVar("T", bound=Message)


async def listen(bus: ZenohConfig, wait: Callable[[], object]) -> Sent:
    """Note what is sent until `wait` returns, which is called on a thread."""
    sent = Sent()
    transport = ZenohTransport(bus)

    async def hear(topic: Topic[T], note: Callable[[T, float], None]) -> None:
        stream = transport.stream(topic)
        async for message in stream:
            note(message, asyncio.get_running_loop().time() - stream.age_s)

    tasks = (
        asyncio.create_task(hear(topics.CLOCK, lambda tick, sent_s: sent.ticks.append((tick.stamp_ns, sent_s)))),
        asyncio.create_task(hear(topics.FLOW, lambda status, sent_s: sent.decisions_s.append(sent_s))),
        asyncio.create_task(hear(topics.STEREO_IMAGES, lambda seen, at_s: sent.note(PICTURES, seen.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.OBSERVATION, lambda seen, at_s: sent.note(CLOUD, seen.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.TARGETS, lambda found, at_s: sent.note(TARGETS, found.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.STATE, lambda state, at_s: sent.note(STATE, state.observed_stamp_ns, at_s))),
    )
    try:
        await asyncio.to_thread(wait)
    finally:
        for task in tasks:
            task.cancel()
        await transport.close()
    return sent
