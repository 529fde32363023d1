"""Records a new run or one that already runs: sets up the file, clock and metadata."""

import asyncio
import os
import platform
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy

from dlokit import __version__
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.topic import Topic
from dlokit.communication.topics import all_topics
from dlokit.communication.transport import Transport, first_message
from dlokit.recording.channels import (
    CALLS,
    FILE_NAME,
    IMAGE_FORMAT,
    IMAGE_QUALITY,
    IMAGES_PER_S,
)
from dlokit.recording.disk import Disk
from dlokit.recording.recorder import Recorder
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import read_toml, to_toml
from dlokit.system.processes.bus import JoinBus, join_bus
from dlokit.system.processes.running import RunningSystem, still_runs
from dlokit.system.results.run_result import config_hash
from dlokit.system.table import instances_of_run

LIBRARIES = ("mcap", "mujoco", "numpy", "scipy", "numba", "daqp", "eclipse-zenoh", "msgspec")


def what_rounds() -> dict[str, str]:
    """The environment that affects rounding: versions, and the instruction sets of compiled kernels and NumPy.

    A run is repeatable to the bit where all of these are equal.
    """
    from llvmlite.binding import get_host_cpu_name  # imported here: most processes compile nothing

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
    """Metadata of the file: name, versions and configuration of the run."""
    toml = to_toml(config)
    return {
        "run": {
            "name": name,
            "runtime": config.runtime,
            "seed": str(config.seed),
            **({"twin": "camera, DLO and finger feedback simulated"} if config.mirrors_arm else {}),
            "config_hash": config_hash(toml),
        },
        "versions": {"dlokit": __version__, **what_rounds()},
        "configuration": {"config.toml": toml},
        "pictures": {"codec": IMAGE_FORMAT, "quality": str(IMAGE_QUALITY), "pairs per s": f"{IMAGES_PER_S:g}"},
    }


@contextmanager
def lockstep_recorder(
    config: RunConfig, name: str, folder: Path, clock: Clock, disk: Disk
) -> Generator[Recorder | None]:
    """The recorder of a lockstep run, synchronous with the run; None when the configuration disables it.

    `disk` notes a failure.
    """
    if not config.record:
        yield None
        return
    metadata = run_metadata(config, name)
    failed, edges_world = partial(disk.fail, FILE_NAME), config.scene.edges_world
    with Recorder(
        folder / FILE_NAME, clock.now_ns, metadata, waits=True, failed=failed, edges_world=edges_world
    ) as recorder:
        yield recorder


@contextmanager
def live_recorder(
    config: RunConfig, name: str, folder: Path, clock: Clock, transport: Transport, disk: Disk
) -> Generator[Recorder | None]:
    """Record all topics and calls of a live run; yields None when the configuration disables it."""
    if not config.record:
        yield None
        return
    with bus_recorder(folder / FILE_NAME, run_metadata(config, name), config, clock, transport, disk) as recorder:
        yield recorder


@contextmanager
def bus_recorder(
    path: Path,
    metadata: Mapping[str, Mapping[str, str]],
    config: RunConfig,
    clock: Clock,
    transport: Transport,
    disk: Disk,
) -> Generator[Recorder]:
    """Record the bus of a live system with this configuration from now on; `disk` notes a failure."""
    # The network threads have no running loop.
    now_ns = clock.now_ns if isinstance(clock, FollowedClock) else time.monotonic_ns
    failed, edges_world = partial(disk.fail, path.name), config.scene.edges_world
    with Recorder(path, now_ns, metadata, waits=False, failed=failed, edges_world=edges_world) as recorder:
        for topic in topics_of_run(config):
            transport.tap(topic, lambda data, topic=topic: recorder.put(topic, data))
        yield recorder


def topics_of_run(config: RunConfig) -> list[Topic[Any]]:
    """All recorded topics, of every component instance."""
    others = instances_of_run(config)
    rows = (*all_topics(), *CALLS)
    return [topic for row in rows for topic in (row, *(row.at(one) for one in others.get(row.publisher, ())))]


LAST_WITHIN_S = 1.0
"""Time for a publisher to answer with its last message, normally within a millisecond [s]."""
LOOK_EVERY_S = 0.5
"""Period of checks whether the system still runs [s]."""


async def record_until_ended(
    system: RunningSystem, path: Path, say: Callable[[str], None], join: JoinBus = join_bus
) -> str:
    """Record every topic and call of a running system into a file, until the system ends or this is cancelled.

    The file begins with the last message of each topic. Returns why it has ended: the system, or the disk.
    Raises `ProcessFailure` when the system's clock does not advance.
    """
    config, disk = read_toml(Path(system.folder) / "config.toml", RunConfig), Disk()
    async with join(system.bus, system.time_base) as bus:
        await bus.first_tick()
        metadata = run_metadata(config, Path(system.folder).name)
        metadata["run"]["attached"] = f"{datetime.now():%Y-%m-%d %H:%M:%S}"
        with bus_recorder(path, metadata, config, bus.clock, bus.transport, disk) as recorder:
            say(f"recording {system.folder} into {path}; Ctrl-C ends it")
            # Periodic topics repeat soon.
            lasting = [topic for topic in topics_of_run(config) if topic.rate_hz is None]
            await asyncio.gather(*(put_last(bus.transport, topic, recorder) for topic in lasting))
            while still_runs(system):
                if disk.failures:
                    return f"the recording has ended: {disk.failures[path.name]}"
                await asyncio.sleep(LOOK_EVERY_S)
    return "the system has ended"


async def put_last(transport: Transport, topic: Topic[Any], recorder: Recorder) -> None:
    """Record the previous message of a topic, if it exists and no newer one has arrived."""
    last = await first_message(transport, topic, LAST_WITHIN_S)
    if last is not None and not recorder.has(topic):
        recorder.put(topic, last)
