"""Recording a live system that runs already, from another process."""

import asyncio
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from dlokit.communication.topic import Topic
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.recording.recorder import Recorder
from dlokit.system.config import RunConfig
from dlokit.system.joined_bus import JoinedBus, join_bus
from dlokit.system.processes import TimeBase
from dlokit.system.recording import bus_recorder, run_metadata, topics_of_run
from dlokit.system.running import RunningSystem, still_runs
from dlokit.system.toml_config import read_toml

FIRST_TICK_S = 10.0
LAST_WITHIN_S = 1.0
"""A writer answers for its last message within a millisecond."""
LOOK_EVERY_S = 0.5
"""How often it is looked whether the system still runs."""


async def record_until_ended(system: RunningSystem, path: Path, say: Callable[[str], None]) -> None:
    """Record every topic and call of a running system into a file, until it ends or this is cancelled.

    What was said last before comes first. Raises `ProcessFailure` when the system's clock does not tick.
    """
    config = read_toml(Path(system.folder) / "config.toml", RunConfig)
    async with join_bus(system.bus, TimeBase.CELL) as bus:
        await bus.first_tick(FIRST_TICK_S)
        metadata = run_metadata(config, Path(system.folder).name)
        metadata["run"]["attached"] = f"{datetime.now():%Y-%m-%d %H:%M:%S}"
        with bus_recorder(path, metadata, config, bus.clock, bus.transport) as recorder:
            say(f"recording {system.folder} into {path}; Ctrl-C ends it")
            await _record(system, config, bus, recorder)


async def _record(system: RunningSystem, config: RunConfig, bus: JoinedBus, recorder: Recorder) -> None:
    # What comes at a rate comes again soon.
    lasting = [topic for topic in topics_of_run(config) if topic.rate_hz is None]
    await asyncio.gather(*(_put_last(bus.transport, topic, recorder) for topic in lasting))
    while True:
        if not still_runs(system):
            return
        await asyncio.sleep(LOOK_EVERY_S)


async def _put_last(transport: ZenohTransport, topic: Topic[Any], recorder: Recorder) -> None:
    """Record the last message of before, unless there was none or a newer one has come meanwhile."""
    try:
        async with asyncio.timeout(LAST_WITHIN_S):
            last = await anext(transport.stream(topic, with_last=True))
    except (TimeoutError, StopAsyncIteration):
        return
    if not recorder.has(topic):
        recorder.put(topic, last)
