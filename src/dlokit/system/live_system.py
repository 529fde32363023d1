"""Starts and watches the processes of a live system, from its decision process."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from dlokit.communication.container import end_tasks, first_of
from dlokit.communication.port import Compute
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.zenoh.session import OpenSession, ZenohConfig, open_session
from dlokit.errors import ProcessFailure
from dlokit.recording.disk import Disk
from dlokit.system.processes.bus import SystemTransport, join_bus
from dlokit.system.processes.freed_memory import freed_memory_returned
from dlokit.system.processes.running import announced
from dlokit.system.processes.sockets import local_bus
from dlokit.system.processes.supervisor import Launch, Supervisor
from dlokit.system.processes.workers import worker_pool
from dlokit.system.table import ProcessRow

T = TypeVar("T")

NOTICE_S = 4.0
"""Delay before a task is cancelled [s]: its unanswered call has already failed, and the task makes the arm safe."""
WIND_UP_S = 10.0
"""Time for a task to end and report its result after a process has died [s]."""
TICK_S = 0.02
SEEN_WITHIN_S = 10.0
"""Longest wait to find ready processes on the bus [s]; normally it takes milliseconds."""


class WatchedElsewhere(Protocol):
    """Processes of the system that are not watched by the supervisor of this process: those on other hosts."""

    async def wait_failed(self) -> None:
        """Never return, but raise `ProcessFailure` when one has ended."""
        ...


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
    elsewhere: WatchedElsewhere | None = None
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
                # Still watched: if the clock died now, the task would never end.
                await asyncio.wait({task, watch}, return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                return task.result()
            return await self._wind_up(task, watch, when_failed)
        finally:
            await end_tasks(task, watch)

    async def _wait_failed(self) -> None:
        """Never return, but raise when an essential process or the processes of another host have ended."""
        watches = [self.supervisor, *([] if self.elsewhere is None else [self.elsewhere])]
        await first_of(*(watch.wait_failed() for watch in watches))

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
    """Advance the clock at the machine's rate after the cell has died; components would wait forever otherwise."""
    while isinstance(clock, FollowedClock):
        await asyncio.sleep(TICK_S)
        clock.tick(clock.now_ns() + round(TICK_S * 1e9))


@asynccontextmanager
async def beginning(compute: Compute, work: Callable[[], object] | None) -> AsyncGenerator[None]:
    """Start `work` in the background; a component that needs its results earlier loads them itself or waits."""
    if work is None:
        yield
        return
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
    meanwhile: Callable[[], object] | None = None,
    disk: Disk | None = None,
) -> AsyncGenerator[LiveSystem]:
    """Start all processes except the first row, which is this process; stop them in reverse order at the end.

    They connect over sockets in a folder of this user. The worker of this process runs `meanwhile`, which must be
    picklable, during the start.
    Raises `ProcessFailure` when one does not start; `MachineError` when the folder cannot be created.
    """
    own, *others = rows
    names = [row.name for row in others]
    disk = disk or Disk()
    # Announced before the first process starts, so that `dlokit stop` also works during the start.
    with (
        local_bus(launch.namespace) as local,
        announced(launch.run_dir, local, time_base=own.time_base) as announcement,
        worker_pool() as compute,
        freed_memory_returned(),
    ):
        async with (
            join_bus(local.first(), own.time_base, open_session) as bus,
            beginning(compute, meanwhile),
            Supervisor(tuple(others), launch, lambda name: local.process(name, names), disk) as supervisor,
        ):
            await supervisor.guard(bus.first_tick())
            await supervisor.guard(all_seen(bus.transport, [name for row in others for name in row.components]))
            announcement.ready()
            try:
                yield LiveSystem(bus.transport, bus.clock, compute, supervisor, local.guest, disk)
            finally:
                announcement.ending()


async def all_seen(transport: SystemTransport, components: list[str]) -> None:
    """Wait until the bus has these components. Raises `ProcessFailure` with ``component_missing``."""
    for component in components:
        if not await transport.wait_for(component, SEEN_WITHIN_S):
            raise ProcessFailure(
                f"component_missing: {component}", "its process runs, but does not serve it on the bus"
            )


def namespace_of(run_dir: Path) -> str:
    """The namespace of one run folder on the bus."""
    return "dlokit/" + run_dir.resolve().as_posix().strip("/").replace("/", "_").replace("*", "_")
