"""Live processes with tiny components: they start, are supervised, and all end with the system."""

import asyncio
import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
from tiny_process import ECHO, HANG, THREADS, WORKER
from tiny_system import BROKEN, UNPLUGGED, echo_row, tiny_system

from dlokit.errors import InputError, ProcessFailure
from dlokit.system.live import LiveSystem
from dlokit.system.processes import freed_memory
from dlokit.system.table import ProcessRow, Restart
from dlokit.types.outcome import Succeeded, Unreachable

WAIT_S = 60.0  # starting a process takes a second; many on a loaded machine take more


def live(coroutine: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(WAIT_S * 2):
            await coroutine

    asyncio.run(limited())


async def eventually(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(WAIT_S):
        for _ in itertools.count():
            if condition():
                return
            await asyncio.sleep(0.02)


def runs(pid: int) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


@asynccontextmanager
async def none_left(run_dir: Path, *rows: ProcessRow) -> AsyncGenerator[LiveSystem]:
    pids: list[int] = []
    try:
        async with tiny_system(run_dir, *rows) as system:
            pids.extend(system.supervisor.pids.values())
            yield system
    finally:
        assert not [pid for pid in pids if runs(pid)]


async def never() -> str:
    await asyncio.Event().wait()
    return "ended by itself"


async def result_of(system: LiveSystem, what_happens: Callable[[], object]) -> str:
    """Provoke an event while a task runs that returns an outcome, as the shape task does."""

    async def task() -> str:
        what_happens()
        try:
            return await never()
        except asyncio.CancelledError:
            await system.clock.sleep(0.1)
            return "wound up"

    return await system.run(task(), lambda result, failure: f"{result} after {failure.reason}")


def test_processes_start_answer_calls_on_the_cells_clock_and_end(tmp_path: Path) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row()) as system:
            assert system.clock.now_ns() > 0
            outcome = await system.transport.call(ECHO, "hello")
            assert isinstance(outcome, Succeeded)
            assert outcome.result == "hello"

    live(body())


def test_heavy_work_runs_in_a_worker_that_ends_with_its_process(tmp_path: Path) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row()) as system:
            outcome = await system.transport.call(WORKER)
            assert isinstance(outcome, Succeeded)
            assert outcome.result not in system.supervisor.pids.values()
            assert runs(outcome.result)
            os.kill(system.supervisor.pids["echo"], signal.SIGKILL)
            await eventually(lambda: not runs(outcome.result))

    live(body())


def test_all_processes_of_a_run_return_the_memory_that_they_have_freed(tmp_path: Path) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row()) as system:
            assert freed_memory.THREAD in [thread.name for thread in threading.enumerate()]
            outcome = await system.transport.call(THREADS)
            assert isinstance(outcome, Succeeded)
            assert freed_memory.THREAD in outcome.result

    live(body())


@pytest.mark.parametrize("victim", ["echo", "cell"])
def test_a_killed_process_ends_the_task_with_a_named_failure(tmp_path: Path, victim: str) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row()) as system:
            said = await result_of(system, lambda: os.kill(system.supervisor.pids[victim], signal.SIGKILL))
            assert said == f"wound up after process_died: {victim}"
            if victim == "echo":
                assert isinstance(await system.transport.call(ECHO, "hello"), Unreachable)

    live(body())


def test_a_task_without_a_result_raises_the_failure_with_the_end_of_the_log(tmp_path: Path) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row()) as system:
            os.kill(system.supervisor.pids["echo"], signal.SIGKILL)
            with pytest.raises(ProcessFailure, match=r"process_died: echo: echo ended with signal 9"):
                await system.run(never(), lambda result, failure: result)

    live(body())


@pytest.mark.parametrize("stopped_from_outside", [False, True], ids=["busy loop", "SIGSTOP"])
def test_a_frozen_process_is_killed_and_named(tmp_path: Path, stopped_from_outside: bool) -> None:
    async def body() -> None:
        async with none_left(tmp_path, echo_row(silent_for_s=1.5)) as system:
            tasks: list[asyncio.Task[Any]] = []

            def freeze() -> None:
                if stopped_from_outside:
                    os.kill(system.supervisor.pids["echo"], signal.SIGSTOP)
                else:
                    tasks.append(asyncio.create_task(system.transport.call(HANG)))

            assert await result_of(system, freeze) == "wound up after process_frozen: echo"
            await asyncio.gather(*tasks)

    live(body())


def test_a_process_that_is_not_essential_is_restarted_and_the_task_continues(tmp_path: Path) -> None:
    again = Restart(times=1, window_s=600.0, wait_s=0.1)

    async def body() -> None:
        async with none_left(tmp_path, echo_row(essential=False, restart=again)) as system:
            first = system.supervisor.pids["echo"]
            os.kill(first, signal.SIGKILL)
            await eventually(lambda: system.supervisor.pids["echo"] != first)
            assert await system.transport.wait_for("echo", WAIT_S)
            assert isinstance(await system.transport.call(ECHO, "again"), Succeeded)

    live(body())


def test_a_component_that_raises_ends_the_start_with_its_error_in_the_message(tmp_path: Path) -> None:
    async def body() -> None:
        with pytest.raises(ProcessFailure, match=r"process_died: lamp[\s\S]*the lamp is not plugged in"):
            async with none_left(tmp_path, BROKEN) as system:
                await system.run(never(), lambda result, failure: result)

    live(body())


def test_a_component_that_the_machine_cannot_run_ends_the_start_with_one_clear_line(tmp_path: Path) -> None:
    async def body() -> None:
        line = "port 8080 is in use: end the other viewer, or choose another port"
        with pytest.raises(InputError, match=f"^{line}$"):
            async with none_left(tmp_path, UNPLUGGED) as system:
                await system.run(never(), lambda result, failure: result)

    live(body())


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name)
def test_no_process_outlives_the_one_that_started_it(tmp_path: Path, how: signal.Signals) -> None:
    program = (sys.executable, str(Path(__file__).with_name("tiny_system.py")), str(tmp_path))
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pids = [int(word) for word in parent.stdout.readline().split()]
        assert len(pids) == 2
        assert all(runs(pid) for pid in pids)
        parent.send_signal(how)
        try:
            parent.wait(WAIT_S)
        finally:
            parent.kill()
    live(eventually(lambda: not any(runs(pid) for pid in pids)))


def test_a_cell_runs_on_briefly_after_its_parent_died_so_that_its_arm_can_brake(tmp_path: Path) -> None:
    program = (sys.executable, str(Path(__file__).with_name("tiny_system.py")), str(tmp_path))
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pids = [int(word) for word in parent.stdout.readline().split()]
        killed_s = time.time()
        parent.kill()
    live(eventually(lambda: not any(runs(pid) for pid in pids)))
    ended_s = (tmp_path / "logs" / "cell.log").stat().st_mtime
    assert ended_s - killed_s > 1.0  # of the two seconds that it runs on after its parent
