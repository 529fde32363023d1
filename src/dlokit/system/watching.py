"""A recorded run on the viewer's page, at any rate."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from dlokit.communication.container import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.recording.channels import topic_of
from dlokit.recording.reader import Recorded, read_recording
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.system.build import build_viewer, instances_of_run
from dlokit.system.config import RunConfig
from dlokit.system.tasks import end_tasks

WATCHED_PARTS = ("viewer", "model", "task")
"""Of the configuration, what the viewer is built from."""


def watch(path: Path, config: RunConfig, rate: float, port: int | None, say: Callable[[str], None]) -> None:
    """Serve the page, play the recording `rate` times as fast as it was, and stay until Ctrl-C.

    `port` takes the place of the configured one. Raises `InputError` when the file is no recording, `MachineError`
    when the port cannot be had.
    """
    if port is not None:
        config = replace(config, viewer=replace(config.viewer, port=port))
    try:
        asyncio.run(show(path, config, rate, say))
    except KeyboardInterrupt:
        say("the page is closed")


async def show(path: Path, config: RunConfig, rate: float, say: Callable[[str], None]) -> None:
    """As `watch`, until it is cancelled."""
    transport, clock = MemoryTransport(), LoopClock()
    host = Host(transport, clock, instances=instances_of_run(config))
    viewer = build_viewer(config, operated=False)
    host.add(viewer)
    wanted = _Read()
    async with host:
        fault = asyncio.create_task(host.wait_failed())
        playing = asyncio.create_task(_play(transport, clock, read_recording(path, wanted), rate, viewer, say))
        try:
            await asyncio.wait({fault, playing}, return_when=asyncio.FIRST_COMPLETED)
            (fault if fault.done() else playing).result()
            await fault  # the page stays
        finally:
            await end_tasks(fault, playing)


class _Read:
    """The topics that the viewer reads, whosever they are."""

    def __init__(self) -> None:
        self._rows = {topic.name for topic in ViewerComponent.subscribes()}

    def __contains__(self, channel: object) -> bool:
        topic = topic_of(str(channel))
        return topic is not None and topic.row in self._rows


async def _play(
    transport: MemoryTransport,
    clock: LoopClock,
    messages: Iterator[Recorded],
    rate: float,
    viewer: ViewerComponent,
    say: Callable[[str], None],
) -> None:
    await viewer.opened.wait()
    say(f"viewer: {viewer.url}")
    first_ns, began_ns = None, clock.now_ns()
    for one in messages:
        first_ns = one.log_ns if first_ns is None else first_ns
        await clock.sleep_until(began_ns + round((one.log_ns - first_ns) / rate))
        topic = topic_of(one.topic)
        assert topic is not None, f"{one.topic} was read, so it is known"
        transport.publish(topic, one.message)
    say("The recording is at its end; Ctrl-C closes the page.")
