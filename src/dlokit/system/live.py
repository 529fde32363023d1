"""The live runtime: each process of the table runs at its own rate, over zenoh; the task runs in this process."""

import asyncio
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from dlokit.communication import topics
from dlokit.communication.container import Container, end_tasks
from dlokit.communication.port import Compute
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.decision.component import DecisionComponent
from dlokit.errors import ProcessFailure
from dlokit.recording.disk import Disk
from dlokit.skills.planning.strategies import load
from dlokit.system.build import Wiring, build_component, instances_of_run, rows_of_run
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.hosts.config import HostsConfig
from dlokit.system.hosts.placement import Placement, placed
from dlokit.system.hosts.remote_processes import RemoteProcesses
from dlokit.system.hosts.routers import NAMESPACE, limited_links, main_router_config
from dlokit.system.processes.bus import JoinedBus, SystemTransport, join_bus
from dlokit.system.processes.freed_memory import freed_memory_returned
from dlokit.system.processes.lease_keeper import leases_held
from dlokit.system.processes.report import NAME as REPORT_FILE
from dlokit.system.processes.running import announced
from dlokit.system.processes.sockets import local_bus
from dlokit.system.processes.supervisor import PROCESS, Launch, Supervisor
from dlokit.system.processes.workers import worker_pool
from dlokit.system.results.recording import calls_published, live_recorder, put_last
from dlokit.system.results.run_folder import HIDDEN_START, write_config, write_start
from dlokit.system.results.run_record import RunRecord
from dlokit.system.session import shape_until_ended
from dlokit.system.shaping import ShapeJob, Stop, Watcher, shape, until_stopped
from dlokit.system.table import DECISION, ProcessRow
from dlokit.system.toml_config import to_toml
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import RunOutcome

T = TypeVar("T")
C = TypeVar("C")

NOTICE_S = 4.0
"""Delay before a task is cancelled [s]: its unanswered call has already failed, and the task makes the arm safe."""
WIND_UP_S = 10.0
"""Time for a task to end and report its result after a process has died [s]."""
TICK_S = 0.02
SEEN_WITHIN_S = 10.0
"""Time to find ready processes on the bus, which takes milliseconds [s]."""


@dataclass(frozen=True)
class LiveSystem:
    """A running system, as seen by its decision process."""

    transport: SystemTransport
    clock: Clock
    """The cell's time, or the machine's time without a cell."""
    compute: Compute
    supervisor: Supervisor
    bus: ZenohConfig
    """How another process of this machine joins the bus."""
    disk: Disk
    """Writes the files of the run."""
    shares: RemoteProcesses | None = None
    """The processes on other hosts."""

    async def run(self, main: Coroutine[Any, Any, T], when_failed: Callable[[T, ProcessFailure], T]) -> T:
        """Run `main` and return its result; cancel it when an essential process dies, or on Ctrl-C.

        If `main` returns a result despite the cancellation, that result is returned; after the death of a process
        `when_failed` adds the cause. Raises `ProcessFailure` if there is no result, and `InputError` when a process
        could not work on this machine or with this configuration.
        """
        task = asyncio.create_task(main, name="main")
        watch = asyncio.create_task(self._wait_failed(), name="watch")
        try:
            try:
                await asyncio.wait({task, watch}, return_when=asyncio.FIRST_COMPLETED)
            except asyncio.CancelledError:
                task.cancel()
                # Watched all the same: with a clock that died now, the task would never end.
                await asyncio.wait({task, watch}, return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                return task.result()
            return await self._wind_up(task, watch, when_failed)
        finally:
            await end_tasks(task, watch)

    async def _wait_failed(self) -> None:
        """Never return, but raise when an essential process or the processes of another host have ended."""
        if self.shares is None:
            return await self.supervisor.wait_failed()
        own = asyncio.create_task(self.supervisor.wait_failed(), name="watch this host")
        others = asyncio.create_task(self.shares.wait_failed(), name="watch other hosts")
        try:
            done, _ = await asyncio.wait({own, others}, return_when=asyncio.FIRST_COMPLETED)
            done.pop().result()
        finally:
            await end_tasks(own, others)

    async def _wind_up(
        self, task: "asyncio.Task[T]", watch: "asyncio.Task[None]", when_failed: Callable[[T, ProcessFailure], T]
    ) -> T:
        failure = watch.exception()
        assert failure is not None, "the watch ends only with a failure"
        going_on = asyncio.create_task(_let_time_go_on(self.clock), name="time goes on")
        try:
            await asyncio.wait({task}, timeout=NOTICE_S)
            task.cancel()
            await asyncio.wait({task}, timeout=WIND_UP_S)
            if (
                isinstance(failure, ProcessFailure)
                and task.done()
                and not task.cancelled()
                and task.exception() is None
            ):
                return when_failed(task.result(), failure)
            raise failure
        finally:
            await end_tasks(going_on)


async def _let_time_go_on(clock: Clock) -> None:
    """Advance the clock at the machine's rate, because components would wait forever on the clock of a dead cell."""
    while isinstance(clock, FollowedClock):
        await asyncio.sleep(TICK_S)
        clock.tick(clock.now_ns() + round(TICK_S * 1e9))


def _nothing() -> None:
    pass


@asynccontextmanager
async def _beginning(compute: Compute, work: Callable[[], object]) -> AsyncGenerator[None]:
    """Start `work` in the background; a component that needs its results earlier loads them itself or waits."""
    working = asyncio.create_task(compute(work), name="meanwhile")
    try:
        yield
    finally:
        await end_tasks(working)


@asynccontextmanager
async def live_system(
    rows: tuple[ProcessRow, ...],
    launch: Launch,
    open_session: OpenSession = open_session,
    meanwhile: Callable[[], object] = _nothing,
    disk: Disk | None = None,
) -> AsyncGenerator[LiveSystem]:
    """Start all processes except the first row, which is this process; stop them in reverse order at the end.

    They meet over sockets in a folder of this user. The worker of this process does `meanwhile` during the start.
    Raises `ProcessFailure` when one does not start; `MachineError` when there can be no such folder.
    """
    own, *others = rows
    names = [row.name for row in others]
    disk = disk or Disk()
    # Announced before the first process starts, so that `dlokit stop` also works during the start.
    with (
        local_bus(launch.namespace) as local,
        announced(launch.run_dir, local, time_base=own.time_base) as ready,
        worker_pool() as compute,
        freed_memory_returned(),
    ):
        async with (
            join_bus(local.first(), own.time_base, open_session) as bus,
            _beginning(compute, meanwhile),
            Supervisor(tuple(others), launch, lambda name: local.process(name, names), disk) as supervisor,
        ):
            await supervisor.guard(bus.first_tick())
            await supervisor.guard(_all_seen(bus.transport, [name for row in others for name in row.components]))
            ready()
            yield LiveSystem(bus.transport, bus.clock, compute, supervisor, local.guest, disk)


@asynccontextmanager
async def spread_system(
    rows: tuple[ProcessRow, ...],
    launch: Launch,
    hosts: HostsConfig,
    config_toml: str,
    say: Callable[[str], None],
    meanwhile: Callable[[], object] = _nothing,
    disk: Disk | None = None,
) -> AsyncGenerator[LiveSystem]:
    """As `live_system`, on several hosts; `dlokit host` starts the processes of the others.

    `config_toml` is the configuration of all of them. Raises `ConfigError` for invalid `hosts`, and `ProcessFailure`
    when a host is missing, or its processes do not start.
    """
    placement = placed(hosts, rows)
    disk = disk or Disk()
    own, *here = placement.own
    with (
        local_bus(NAMESPACE) as local,
        announced(launch.run_dir, local, client=True, time_base=own.time_base) as ready,
        worker_pool() as compute,
        freed_memory_returned(),
    ):
        async with (
            join_bus(main_router_config(hosts, placement, local), own.time_base) as bus,
            limited_links(hosts.endpoint),
            _beginning(compute, meanwhile),
            _shares(bus, placement, config_toml, hosts, say) as shares,
            Supervisor(tuple(here), launch, lambda _: local.client(), disk) as supervisor,
        ):
            await supervisor.guard(bus.first_tick())
            if not placement.clock_elsewhere:
                await supervisor.guard(shares.start())
            try:
                components = [name for row in rows[1:] for name in row.components]
                await supervisor.guard(_all_seen(bus.transport, components))
                ready()
                yield LiveSystem(bus.transport, bus.clock, compute, supervisor, local.client(), disk, shares)
            finally:
                await shares.end()


async def _all_seen(transport: SystemTransport, components: list[str]) -> None:
    for component in components:
        if not await transport.wait_for(component, SEEN_WITHIN_S):
            raise ProcessFailure(
                f"component_missing: {component}", "its process runs, but does not serve it on the bus"
            )


@asynccontextmanager
async def _shares(
    bus: JoinedBus, placement: Placement, config_toml: str, hosts: HostsConfig, say: Callable[[str], None]
) -> AsyncGenerator[RemoteProcesses]:
    """The processes on other hosts; started already where one of these has the clock that the others wait for."""
    shares = RemoteProcesses(bus.transport, placement.others, config_toml, hosts.wait_s, say)
    if placement.clock_elsewhere:
        await shares.start()
    try:
        yield shares
    finally:
        await shares.end()


def namespace_of(run_dir: Path) -> str:
    """The namespace of one run folder on the bus."""
    return "dlokit/" + run_dir.resolve().as_posix().strip("/").replace("/", "_").replace("*", "_")


log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Starting:
    """How the processes of a live run are started; a study may inject its own."""

    command: tuple[str, ...] = PROCESS
    """Command of every process except this one."""
    open_session: OpenSession = open_session
    """Opens the bus session of this process."""


AS_SHIPPED = Starting()


def run_live(
    config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, starting: Starting = AS_SHIPPED
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
    def run(stop: Stop) -> Awaitable[RunRecord]:
        return result_within(
            started(config, job.name, job.start_nodes_world, folder, starting, disk),
            lambda live: live.run(_decide(live, config, job, folder, watch, stop), _failed),
        )

    return await until_stopped(run, config, job, watch)


@asynccontextmanager
async def started(
    config: RunConfig,
    name: str,
    start_nodes_world: Float64Array,
    folder: Path,
    starting: Starting = AS_SHIPPED,
    disk: Disk | None = None,
) -> AsyncGenerator[LiveSystem]:
    """Start the processes of a run except this one, and record it in `folder`.

    `name` is that of the recording, `start_nodes_world` (K, 3) [m] the hidden start, `disk` writes the files. Raises
    `ProcessFailure`, and `MachineError` when the folder cannot be written.
    """
    disk = disk or Disk()
    _write_inputs(config, start_nodes_world, folder)
    rows = rows_of_run(config)
    launch = Launch(
        namespace=namespace_of(folder),
        config_file=folder / CONFIG_FILE,
        run_dir=folder,
        instances=instances_of_run(config),
        command=starting.command,
    )
    loads = partial(load, config.planning.strategy)
    if config.hosts is None:
        system = live_system(rows, launch, starting.open_session, loads, disk)
    else:
        system = spread_system(rows, launch, config.hosts, to_toml(config), log.warning, loads, disk)
    async with system as live:
        with live_recorder(config, name, folder, live.clock, live.transport, disk) as recorder:
            if recorder is not None and config.moves_real_arm:  # which may have been connected before
                await put_last(live.transport, topics.PROTECTION, recorder)
            yield live


def _write_inputs(config: RunConfig, start_nodes_world: Float64Array, folder: Path) -> None:
    """Write what the processes of a run read."""
    write_config(folder, config)
    write_start(folder, start_nodes_world)


def _failed(record: RunRecord, failure: ProcessFailure) -> RunRecord:
    """The record of a task that was ended by the death of a process."""
    log.error("%s", failure)
    result = msgspec.structs.replace(record.result, outcome=RunOutcome.FAILED, reason=failure.reason)
    return replace(record, result=result)


async def _decide(
    live: LiveSystem, config: RunConfig, job: ShapeJob, folder: Path, watch: Watcher, stop: Stop
) -> RunRecord:
    run = shape_until_ended if job.stays else shape
    return await result_within(
        deciding(live, config, folder),
        lambda decision: run(decision, live.transport, live.clock, config, job, watch, stop),
    )


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
async def deciding(live: LiveSystem, config: RunConfig, folder: Path) -> AsyncGenerator[DecisionComponent]:
    """The components of this process, which commands the arms meanwhile."""
    wiring = Wiring(
        transport=live.transport,
        clock=live.clock,
        folder=folder,
        start_nodes_world=HIDDEN_START,
        disk=live.disk,
    )
    host = Container(live.transport, live.clock, live.compute, instances_of_run(config))
    components = {name: build_component(name, config, wiring) for name in DECISION.components}
    for component in components.values():
        host.add(component)
    decision = components["decision"]
    assert isinstance(decision, DecisionComponent)
    await host.prepare()
    async with host, leases_held(live.transport, live.clock, config.robot, config.mounts):
        with calls_published(live.transport, live.clock):
            yield decision
