"""The recording of a run, also of one that runs already: which file, on which clock, what it says of the run itself."""

import asyncio
import os
import platform
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy

from dlokit import __version__
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.topic import Topic
from dlokit.communication.topics import TOPICS
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.recording.call_log import CallLog
from dlokit.recording.channels import (
    CALLS,
    FILE_NAME,
    IMAGE_FORMAT,
    IMAGE_QUALITY,
    IMAGES_PER_S,
)
from dlokit.recording.recorder import Recorder
from dlokit.system.build import instances_of_run
from dlokit.system.config import RunConfig
from dlokit.system.processes.bus import JoinedBus, join_bus
from dlokit.system.processes.running import RunningSystem, still_runs
from dlokit.system.results.run_result import config_hash
from dlokit.system.table import TimeBase
from dlokit.system.toml_config import read_toml, to_toml
from dlokit.types.message import Message

LIBRARIES = ("mcap", "mujoco", "numpy", "scipy", "numba", "daqp", "eclipse-zenoh", "msgspec")

CABLES = frozenset({"cell"})
"""What drivers ask of the cell goes over a cable in a laboratory, and is not recorded."""


def what_rounds() -> dict[str, str]:
    """What decides how calculations round: versions, and which instructions compiled kernels and NumPy use.

    A run repeats to the bit where all of these are the same.
    """
    from llvmlite.binding import get_host_cpu_name  # here: most processes that load this module compile nothing

    extensions: Any = numpy.show_config(mode="dicts")
    instructions = (
        os.environ.get("NUMBA_CPU_NAME", get_host_cpu_name()),
        *extensions["SIMD Extensions"].get("found", ()),
        os.environ.get("OPENBLAS_CORETYPE", ""),
    )
    return {
        "python": platform.python_version(),
        **{library: version(library) for library in LIBRARIES},
        "processor": " ".join(instructions).strip(),
    }


def run_metadata(config: RunConfig, name: str) -> dict[str, dict[str, str]]:
    """What the file says of the run: its name, its versions, its configuration."""
    toml = to_toml(config)
    return {
        "run": {
            "name": name,
            "runtime": config.runtime,
            "seed": str(config.seed),
            "config_hash": config_hash(toml),
        },
        "versions": {"dlokit": __version__, **what_rounds()},
        "configuration": {"config.toml": toml},
        "pictures": {"codec": IMAGE_FORMAT, "quality": str(IMAGE_QUALITY), "pairs per s": f"{IMAGES_PER_S:g}"},
    }


@contextmanager
def lockstep_recorder(config: RunConfig, name: str, folder: Path, clock: Clock) -> Generator[Recorder | None]:
    """The recorder of a lockstep run, which waits for it; None when the configuration wants no recording."""
    if not config.record:
        yield None
        return
    with Recorder(folder / FILE_NAME, clock.now_ns, run_metadata(config, name), waits=True) as recorder:
        yield recorder


@contextmanager
def live_recorder(
    config: RunConfig, name: str, folder: Path, clock: Clock, transport: ZenohTransport
) -> Generator[None]:
    """Record a live run, every topic and every call; nothing when the configuration wants no recording."""
    if not config.record:
        yield
        return
    with bus_recorder(folder / FILE_NAME, run_metadata(config, name), config, clock, transport):
        yield


@contextmanager
def bus_recorder(
    path: Path, metadata: Mapping[str, Mapping[str, str]], config: RunConfig, clock: Clock, transport: ZenohTransport
) -> Generator[Recorder]:
    """Record what goes over the bus of a live system that is configured so, from now on."""
    # The network's threads have no running loop to ask.
    now_ns = clock.now_ns if isinstance(clock, FollowedClock) else time.monotonic_ns
    with Recorder(path, now_ns, metadata, waits=False) as recorder:
        for topic in topics_of_run(config):
            transport.tap(topic, lambda data, topic=topic: recorder.put(topic, data))
        yield recorder


def topics_of_run(config: RunConfig) -> list[Topic[Any]]:
    """Every topic that is recorded, whosever it is."""
    others = instances_of_run(config)
    rows = (*TOPICS, *CALLS)
    return [topic for row in rows for topic in (row, *(row.at(one) for one in others.get(row.publisher, ())))]


def call_log_of(recorder: Recorder, clock: Clock) -> CallLog:
    """Notes in the recording each skill call of a lockstep run."""
    return CallLog(clock.now_ns, recorder.put, unlogged=CABLES)


@contextmanager
def calls_published(transport: ZenohTransport, clock: Clock) -> Generator[None]:
    """Publish each skill call that this process makes meanwhile, for the process that records."""

    def publish(topic: Topic[Any], message: Message | Callable[[], Message]) -> None:
        transport.publish(topic, message if isinstance(message, Message) else message())

    transport.call_log = CallLog(clock.now_ns, publish, unlogged=CABLES)
    try:
        yield
    finally:
        transport.call_log = None


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
