"""The live runtime: all processes of the table, each at its own rate, over zenoh."""

import asyncio
import socket
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from dlokit.communication.clock import Clock, FollowedClock
from dlokit.communication.compute import Compute
from dlokit.communication.zenoh_session import OpenSession, ZenohConfig, open_session
from dlokit.communication.zenoh_transport import ZenohTransport
from dlokit.errors import MachineError, ProcessFailure
from dlokit.system.joined_bus import join_bus
from dlokit.system.processes import ProcessRow
from dlokit.system.running import announced
from dlokit.system.supervisor import Launch, Supervisor
from dlokit.system.tasks import end_tasks
from dlokit.system.worker_pool import worker_pool

T = TypeVar("T")

FIRST_TICK_S = 30.0
NOTICE_S = 4.0
"""A task whose call was not answered knows already, and makes the arm safe: it is not disturbed at once."""
WIND_UP_S = 10.0
"""Time for a task to end and to say what became of it, once a process has died."""
TICK_S = 0.02
SEEN_WITHIN_S = 10.0
"""Ready processes are on the bus; seeing them there takes milliseconds."""


@dataclass(frozen=True)
class LiveSystem:
    """A running system, as its decision process sees it."""

    transport: ZenohTransport
    clock: Clock
    """The cell's time, or the machine's with hardware."""
    compute: Compute
    supervisor: Supervisor
    bus: ZenohConfig
    """How another process of this machine joins it."""

    async def run(self, main: Coroutine[Any, Any, T], when_failed: Callable[[T, ProcessFailure], T]) -> T:
        """Result of `main`, which is cancelled when an essential process dies, or when the caller is (Ctrl-C).

        A `main` that ends with a result though it was cancelled has that result returned; after a dead process
        `when_failed` says what it means. Raises `ProcessFailure` where there is no result, and `InputError` when a
        process could not work on this machine or with this configuration.
        """
        task = asyncio.create_task(main, name="main")
        watch = asyncio.create_task(self.supervisor.wait_failed(), name="watch")
        try:
            await asyncio.wait({task, watch}, return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                return task.result()
            return await self._wind_up(task, watch, when_failed)
        except asyncio.CancelledError:
            task.cancel()
            return await task
        finally:
            await end_tasks(task, watch)

    async def _wind_up(
        self, task: "asyncio.Task[T]", watch: "asyncio.Task[None]", when_failed: Callable[[T, ProcessFailure], T]
    ) -> T:
        failure = watch.exception()
        assert failure is not None, "the watch ends only with what it has seen"
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
    """Whoever waits on a clock whose cell has died would wait for ever; so it goes on at the machine's pace."""
    while isinstance(clock, FollowedClock):
        await asyncio.sleep(TICK_S)
        clock.tick(clock.now_ns() + round(TICK_S * 1e9))


@asynccontextmanager
async def live_system(
    rows: tuple[ProcessRow, ...], launch: Launch, open_session: OpenSession = open_session
) -> AsyncGenerator[LiveSystem]:
    """Start every process but the first row's, which is this one; stop them in reverse order at the end.

    This process takes a free port of the loopback interface, and the others meet there. Raises `ProcessFailure`
    when one does not start; `MachineError` when no port is free.
    """
    own, *others = rows
    meeting_point = (f"tcp/127.0.0.1:{_free_port()}",)
    own_bus = ZenohConfig(namespace=launch.namespace, listen=meeting_point)
    others_bus = ZenohConfig(namespace=launch.namespace, connect=meeting_point)
    with worker_pool() as compute:
        async with (
            join_bus(own_bus, own.time_base, open_session) as bus,
            Supervisor(tuple(others), launch, others_bus) as supervisor,
        ):
            await supervisor.guard(bus.first_tick(FIRST_TICK_S))
            await supervisor.guard(_all_seen(bus.transport, [name for row in others for name in row.components]))
            with announced(launch.run_dir, launch.namespace, meeting_point[0]):
                yield LiveSystem(bus.transport, bus.clock, compute, supervisor, others_bus)


async def _all_seen(transport: ZenohTransport, components: list[str]) -> None:
    for component in components:
        if not await transport.wait_for(component, SEEN_WITHIN_S):
            raise ProcessFailure(f"component_missing: {component}", "its process runs, but nobody serves it on the bus")


def _free_port() -> int:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", 0))
        except OSError as error:
            raise MachineError(f"no port is free on 127.0.0.1: {error}; end other programs") from error
        return int(probe.getsockname()[1])


def namespace_of(run_dir: Path) -> str:
    """A name on the bus that belongs to one run folder."""
    return "dlokit/" + run_dir.resolve().as_posix().strip("/").replace("/", "_").replace("*", "_")
