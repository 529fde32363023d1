"""The live runtime: each process of the table runs at its own rate, over zenoh; the task runs in this process."""

import asyncio
import itertools
import logging
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.communication.timing.urgency import garbage_frozen
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import OpenSession, open_session
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import ProcessFailure
from dlokit.recording.disk import Disk
from dlokit.skills.planning.config import load
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.job import ShapeJob
from dlokit.system.live_system import LiveSystem, live_system, namespace_of
from dlokit.system.other_hosts import other_hosts
from dlokit.system.processes.bus import calls_published
from dlokit.system.processes.report import NAME as REPORT_FILE
from dlokit.system.processes.supervisor import PROCESS, Launch
from dlokit.system.results.recording import live_recorder, put_last
from dlokit.system.results.run_folder import write_config, write_start
from dlokit.system.results.run_result import RunRecord
from dlokit.system.shaping import (
    Stop,
    Watcher,
    record_of_no_task,
    shape,
    shape_until_ended,
    stopped_by_signals,
    stops_watched,
)
from dlokit.system.table import processes_of_run
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import RunOutcome
from dlokit.types.outcome import Succeeded
from dlokit.types.robot import Lease
from dlokit.types.system import Heartbeat

T = TypeVar("T")
C = TypeVar("C")

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Starting:
    """How the processes of a live run are started; a study may inject its own."""

    command: tuple[str, ...] = PROCESS
    """Command of every process except this one."""
    open_session: OpenSession = open_session
    """Opens the bus session of this process."""


DEFAULT_STARTING = Starting()


def run_live(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, starting: Starting = DEFAULT_STARTING
) -> RunRecord:
    """Run a task to its end; Ctrl-C ends it with outcome `cancelled`. Raises `ProcessFailure` when a process dies."""
    disk = Disk()
    record = asyncio.run(_run(config, job, folder, watch, starting, disk))
    disk.settle()
    # The report on the processes has no use after their end.
    unwritten = {name: why for name, why in disk.failures.items() if name != REPORT_FILE}
    return replace(record, unwritten=unwritten)


async def _run(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, starting: Starting, disk: Disk
) -> RunRecord:
    began_s = time.perf_counter()
    with stopped_by_signals(watch) as stop:
        try:
            return await result_within(
                started(config, job.name, job.start_nodes_world, folder, starting, disk),
                lambda live: live.run(_decide(live, config, job, folder, watch, stop), _failed),
            )
        except asyncio.CancelledError:
            if stop.begun:
                raise
            return record_of_no_task(config, job, stop, wall_time_s=time.perf_counter() - began_s)


@asynccontextmanager
async def started(
    config: RunConfig,
    name: str,
    start_nodes_world: Float64Array,
    folder: Path,
    starting: Starting = DEFAULT_STARTING,
    disk: Disk | None = None,
) -> AsyncGenerator[LiveSystem]:
    """Start the processes of a run except this one, and record it in `folder`.

    `name` names the recording, `start_nodes_world` (K, 3) [m] is the hidden start, `disk` writes the files. Raises
    `ProcessFailure`, and `MachineError` when the folder cannot be written.
    """
    disk = disk or Disk()
    write_config(folder, config)
    write_start(folder, start_nodes_world)
    rows = processes_of_run(config)
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=folder / CONFIG_FILE,
        run_dir=folder,
        command=starting.command,
    )
    loads = partial(load, config.planning.strategy)
    if (hosts := other_hosts(config)) is None:
        system = live_system(rows, launch, starting.open_session, loads, disk)
    else:
        system = hosts.started(rows, launch, to_toml(config), log.warning, loads, disk)
    async with system as live:
        with live_recorder(config, name, folder, live.clock, live.transport, disk) as recorder:
            if recorder is not None and config.moves_real_arm:  # which may have been connected before
                await put_last(live.transport, topics.PROTECTION, recorder)
            yield live


def _failed(record: RunRecord, failure: ProcessFailure) -> RunRecord:
    """The record of a task that was ended by the death of a process."""
    log.error("%s", failure)
    result = msgspec.structs.replace(record.result, outcome=RunOutcome.FAILED, reason=failure.reason)
    return replace(record, result=result)


async def _decide(
    live: LiveSystem, config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, stop: Stop
) -> RunRecord:
    run = shape_until_ended if job.stays else shape

    async def watched(host: Container) -> RunRecord:
        async with stops_watched(live.transport, watch):
            return await run(host, config, job, watch, stop)

    return await result_within(deciding(live, config, folder), watched)


async def result_within(context: AbstractAsyncContextManager[C], work: Callable[[C], Awaitable[T]]) -> T:
    """The result of `work`, which runs inside `context`; a cancellation while the context ends does not discard it.

    Raises `CancelledError` when `work` itself is cancelled, and the errors of both.
    """
    result: list[T] = []
    try:
        async with context as entered:
            result.append(await work(entered))
    except asyncio.CancelledError:
        if not result:
            raise
    return result[0]


@asynccontextmanager
async def deciding(live: LiveSystem, config: RunConfig, folder: Path) -> AsyncGenerator[Container]:
    """The components of this process, which commands the arms while the context is open."""
    wiring = Wiring(transport=live.transport, clock=live.clock, folder=folder, disk=live.disk)
    host = assemble(processes_of_run(config)[0].components, config, wiring, compute=live.compute)
    await host.prepare()
    async with host, leases_held(live.transport, live.clock, config.robot, config.mounts):
        with calls_published(live.transport, live.clock):
            yield host


@asynccontextmanager
async def leases_held(
    transport: Transport, clock: Clock, config: RobotConfig, arms: tuple[ArmMount, ...] = FIRST_ALONE
) -> AsyncGenerator[None]:
    """Hold the lease of every arm with heartbeats from a separate thread.

    `clock` is the run's, for their stamps. Raises `ProcessFailure` when an arm does not grant its lease.
    """
    lease = Lease(holder=transport.identity, duration_s=config.commander_lease_s)
    give = heartbeats(transport, clock)
    pulse = ThreadPulse()
    # Heartbeats start before the first lease is taken: it could expire while the second is requested.
    async with garbage_frozen(), pulse(give, lease.heartbeat_s):
        for mount in arms:
            taken = await transport.call(api.RENEW_LEASE.at(mount.instance), lease.holder, lease.duration_s)
            if not isinstance(taken, Succeeded):
                raise ProcessFailure("no_lease", f"the robot {mount.robot} does not take commands: {taken}")
        try:
            yield
        finally:
            for mount in arms:
                await transport.call(api.RELEASE_LEASE.at(mount.instance), transport.identity)


def heartbeats(transport: Transport, clock: Clock) -> Callable[[], None]:
    """A function that sends one heartbeat of this process, callable on any thread."""
    # The loop's clock can be read only on its own thread; with hardware it is the machine's clock.
    now_ns = clock.now_ns if isinstance(clock, FollowedClock) else time.monotonic_ns
    numbers = itertools.count(1)

    def give() -> None:
        heartbeat = Heartbeat(stamp_ns=now_ns(), seq=next(numbers), holder=transport.identity)
        transport.publish(topics.HEARTBEAT, heartbeat)

    return give
