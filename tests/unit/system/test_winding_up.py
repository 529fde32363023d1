"""A live system after a process has failed: its task gets time to end, is then cancelled, and keeps its result."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import NoReturn

import pytest

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock, FollowedClock, LoopClock
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import DlokitError, InputError, ProcessFailure
from dlokit.recording.disk import Disk
from dlokit.system.live_system import NOTICE_S, WIND_UP_S, LiveSystem
from dlokit.system.processes.supervisor import Launch, Supervisor
from dlokit.system.processes.workers import WorkerCompute

FAILS_AT_S = 1.0
DIED = ProcessFailure("process_died: cell", "signal 9")


class FailingSupervisor(Supervisor):
    """One process, without any process: it fails at a time."""

    def __init__(self, failure: DlokitError | None) -> None:
        launch = Launch(namespace="lamp", config_file=Path("config.toml"), run_dir=Path("run"))
        super().__init__((), launch, lambda name: ZenohConfig(namespace="lamp"))
        self._failure = failure

    async def wait_failed(self) -> NoReturn:
        if self._failure is None:
            await asyncio.Event().wait()
        await asyncio.sleep(FAILS_AT_S)
        raise self._failure or AssertionError("it runs on")


def live(failure: DlokitError | None, clock: Clock | None = None) -> LiveSystem:
    return LiveSystem(
        transport=MemoryTransport(),
        clock=clock or LoopClock(),
        compute=WorkerCompute(),
        supervisor=FailingSupervisor(failure),
        bus=ZenohConfig(namespace="lamp"),
        disk=Disk(),
    )


def with_cause(result: str, failure: ProcessFailure) -> str:
    return f"{result}, {failure.reason}"


def after(work: Callable[[], Awaitable[str]], failure: DlokitError | None) -> tuple[str, float]:
    """Result of a task in a system that fails so, and the time at which it came [s]."""

    async def task() -> str:
        return await work()

    async def main() -> tuple[str, float]:
        began_s = asyncio.get_running_loop().time()
        result = await live(failure).run(task(), with_cause)
        return result, round(asyncio.get_running_loop().time() - began_s, 3)

    return virtual_time.run(main())


async def lasting(seconds: float) -> str:
    await asyncio.sleep(seconds)
    return "done"


async def going_on(winds_up_s: float = 0.0) -> str:
    """A task that ends only when it is cancelled, and then takes its time."""
    try:
        await asyncio.Event().wait()
    except asyncio.CancelledError:
        await asyncio.sleep(winds_up_s)
    return "stopped"


def test_without_a_failure_the_result_is_that_of_the_task() -> None:
    assert after(lambda: lasting(60.0), None) == ("done", 60.0)


def test_a_task_that_ends_by_itself_after_a_failure_is_not_cancelled_and_gets_the_cause() -> None:
    ends_s = FAILS_AT_S + 0.9 * NOTICE_S
    assert after(lambda: lasting(ends_s), DIED) == ("done, process_died: cell", ends_s)


def test_a_task_that_goes_on_is_cancelled_after_its_notice_and_its_result_is_kept() -> None:
    result, ended_s = after(lambda: going_on(0.9 * WIND_UP_S), DIED)
    assert result == "stopped, process_died: cell"
    assert ended_s == FAILS_AT_S + NOTICE_S + 0.9 * WIND_UP_S


def test_a_task_that_does_not_end_after_its_cancellation_is_given_up() -> None:
    ended_s: list[float] = []

    async def stubborn() -> str:
        try:
            return await going_on(1000.0)
        finally:
            ended_s.append(asyncio.get_running_loop().time())

    async def main() -> None:
        began_s = asyncio.get_running_loop().time()
        with pytest.raises(ProcessFailure, match="process_died: cell"):
            await live(DIED).run(stubborn(), with_cause)
        assert ended_s == pytest.approx([began_s + FAILS_AT_S + NOTICE_S + WIND_UP_S])

    virtual_time.run(main())


def test_the_failure_of_the_process_is_named_when_the_task_has_no_result() -> None:
    async def fails() -> str:
        await asyncio.sleep(FAILS_AT_S + 1.0)
        raise ZeroDivisionError("a mistake in the task")

    async def cancelled() -> str:
        await asyncio.Event().wait()
        return "never"

    for work in (fails, cancelled):
        with pytest.raises(ProcessFailure, match="process_died: cell"):
            after(work, DIED)


def test_a_process_that_cannot_work_with_its_configuration_leaves_no_result() -> None:
    with pytest.raises(InputError, match="no lamp"):
        after(lambda: lasting(FAILS_AT_S + 1.0), InputError("no lamp"))


def test_ctrl_c_cancels_the_task_whose_result_is_kept() -> None:
    async def main() -> None:
        running = asyncio.create_task(live(None).run(going_on(3.0), with_cause))
        await asyncio.sleep(1.0)
        running.cancel()
        assert await running == "stopped"

    virtual_time.run(main())


def test_a_process_that_dies_after_ctrl_c_ends_the_task_as_at_any_other_time() -> None:
    async def main() -> None:
        running = asyncio.create_task(live(DIED).run(going_on(FAILS_AT_S + 0.9 * NOTICE_S), with_cause))
        await asyncio.sleep(0.1)
        running.cancel()
        assert await running == "stopped, process_died: cell"

    virtual_time.run(main())


def test_the_time_of_a_dead_cell_goes_on_at_the_machines_rate_until_the_task_has_ended() -> None:
    async def main() -> None:
        clock = FollowedClock()
        clock.tick(5_000_000_000)

        async def brakes() -> str:
            await clock.sleep(2.0)
            return "stands"

        assert await live(DIED, clock).run(brakes(), with_cause) == "stands, process_died: cell"
        stopped_ns = clock.now_ns()
        assert stopped_ns == pytest.approx(7_000_000_000, abs=50_000_000)  # a tick of 20 ms, and the next turn
        await asyncio.sleep(1.0)
        assert clock.now_ns() == stopped_ns

    virtual_time.run(main())
