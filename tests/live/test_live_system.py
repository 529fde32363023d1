"""Live processes with tiny components: they start, answer, are supervised, and all end with the system."""

import asyncio
import os
import signal
import threading
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from live_systems import HANGS_S, Background, background, eventually, runs
from tiny_process import ECHO, HANG, RELAY, THREADS, WORKER
from tiny_system import CELL, OTHER, alone, empty_system, tiny_system
from tiny_system import ECHO as ECHO_ROW

from dlokit.communication import topics
from dlokit.errors import InputError, ProcessFailure
from dlokit.recording.channels import SKILL_CALLS
from dlokit.system.live_system import LiveSystem
from dlokit.system.processes import freed_memory
from dlokit.system.processes.report import ProcessReport, ProcessState
from dlokit.system.table import ProcessRow
from dlokit.types.flow import Command, OperatorCommand
from dlokit.types.outcome import CallEnd, CallRecord, Succeeded, Unreachable


@pytest.fixture(scope="module")
def loop() -> Generator[Background]:
    with background() as loop:
        yield loop


@pytest.fixture(scope="module")
def system(loop: Background, tmp_path_factory: pytest.TempPathFactory) -> Generator[LiveSystem]:
    with loop.entered(tiny_system(tmp_path_factory.mktemp("tiny"), CELL, ECHO_ROW, OTHER)) as system:
        yield system


def report_of(system: LiveSystem, name: str) -> ProcessReport:
    return next(process for process in system.supervisor.report().processes if process.name == name)


async def until_back(system: LiveSystem, *names: str) -> None:
    """Wait until processes were restarted and run again."""

    def back() -> bool:
        reports = [report_of(system, name) for name in names]
        return all(report.restarts == 1 and report.state is ProcessState.RUNNING for report in reports)

    await eventually(back)


async def until_gone(system: LiveSystem, name: str) -> None:
    """Kill a process until it is not restarted any more."""

    def gone() -> bool:
        report = report_of(system, name)
        if report.state is ProcessState.RUNNING:
            os.kill(report.pid, signal.SIGKILL)
        return report.state is ProcessState.GONE

    await eventually(gone)


async def answers(system: LiveSystem, text: str) -> None:
    """Call the echo."""
    outcome = await system.transport.call(ECHO, text)
    assert isinstance(outcome, Succeeded)
    assert outcome.result == text


async def never() -> str:
    await asyncio.Event().wait()
    return "ended by itself"


def test_processes_answer_calls_on_the_cells_clock(loop: Background, system: LiveSystem) -> None:
    assert system.clock.now_ns() > 0
    loop.run(answers(system, "hello"))


def test_a_call_between_two_processes_is_published_for_the_recording(loop: Background, system: LiveSystem) -> None:
    async def relayed() -> CallRecord:
        ended = system.transport.stream(SKILL_CALLS)
        assert isinstance(await system.transport.call(RELAY, "hello"), Succeeded)
        return await anext(ended)

    record = loop.run(relayed())
    assert (record.skill, record.outcome) == (ECHO.key, CallEnd.SUCCEEDED)
    assert record.arguments == '{"text": "hello"}'


def test_all_processes_of_a_run_return_the_memory_that_they_have_freed(loop: Background, system: LiveSystem) -> None:
    assert freed_memory.THREAD in [thread.name for thread in threading.enumerate()]
    outcome = loop.run(system.transport.call(THREADS))
    assert isinstance(outcome, Succeeded)
    assert freed_memory.THREAD in outcome.result


def test_a_system_has_no_socket_of_the_internet_protocols(system: LiveSystem) -> None:
    for pid in (os.getpid(), *system.supervisor.pids.values()):
        assert psutil.Process(pid).net_connections(kind="inet") == []


def test_two_systems_of_one_machine_do_not_see_each_other(loop: Background, system: LiveSystem, tmp_path: Path) -> None:
    async def body() -> None:
        async with empty_system(tmp_path) as other:
            assert system.transport.alive("echo").alive
            assert not other.transport.alive("echo").alive
            heard = system.transport.stream(topics.COMMAND)
            assert other.transport.latest(topics.COMMAND).value is None
            system.transport.publish(topics.COMMAND, OperatorCommand(stamp_ns=1, seq=1, command=Command.PAUSE))
            assert (await anext(heard)).command is Command.PAUSE
            ticks = system.transport.stream(topics.CLOCK)
            for _ in range(10):  # the other system has had as much time to receive it
                await anext(ticks)
            assert other.transport.latest(topics.COMMAND).value is None

    loop.run(body())


def test_a_busy_loop_and_a_stopped_process_are_killed_by_name_and_restarted_and_the_worker_ends_with_its_process(
    loop: Background, system: LiveSystem, caplog: pytest.LogCaptureFixture
) -> None:
    async def body() -> int:
        outcome = await system.transport.call(WORKER)
        assert isinstance(outcome, Succeeded)
        assert outcome.result not in system.supervisor.pids.values()
        assert runs(outcome.result)
        os.kill(system.supervisor.pids["other"], signal.SIGSTOP)
        hanging = asyncio.create_task(system.transport.call(HANG))
        await until_back(system, "echo", "other")
        await hanging
        assert await system.transport.wait_for("echo", HANGS_S)
        await answers(system, "again")
        return outcome.result

    worker = loop.run(body())
    assert not runs(worker)
    for name in ("echo", "other"):
        assert f"process_frozen: {name}: no heartbeat" in caplog.text


def test_a_process_that_is_not_essential_may_die_for_good(loop: Background, system: LiveSystem) -> None:
    async def body() -> None:
        await until_gone(system, "other")
        ended = asyncio.create_task(system.run(never(), lambda result, failure: result))
        await answers(system, "still here")
        assert not ended.done()
        ended.cancel()
        with suppress(asyncio.CancelledError):
            await ended

    loop.run(body())


def test_a_killed_cell_ends_the_task_with_a_named_failure(loop: Background, system: LiveSystem) -> None:
    async def task() -> str:
        os.kill(system.supervisor.pids["cell"], signal.SIGKILL)
        try:
            return await never()
        except asyncio.CancelledError:  # as the shape task, which returns an outcome
            await system.clock.sleep(0.1)
            return "wound up"

    said = loop.run(system.run(task(), lambda result, failure: f"{result} after {failure.reason}"))
    assert said == "wound up after process_died: cell"
    with pytest.raises(ProcessFailure, match=r"process_died: cell: cell ended with signal 9"):
        loop.run(system.run(never(), lambda result, failure: result))  # a task without a result


def test_a_call_of_a_killed_process_is_unreachable(loop: Background, system: LiveSystem) -> None:
    async def body() -> None:
        await until_gone(system, "echo")
        assert isinstance(await system.transport.call(ECHO, "hello"), Unreachable)

    loop.run(body())


async def started(run_dir: Path, *rows: ProcessRow) -> None:
    async with tiny_system(run_dir, *rows) as system:
        await system.run(never(), lambda result, failure: result)


def test_a_component_that_raises_ends_the_start_with_its_error_as_the_last_line(
    loop: Background, tmp_path: Path
) -> None:
    with pytest.raises(
        ProcessFailure, match=r"process_died: broken[\s\S]*RuntimeError: the lamp is not plugged in\s*\Z"
    ):
        loop.run(started(tmp_path, alone("broken")))


def test_a_component_that_the_machine_cannot_run_ends_the_start_with_one_clear_line(
    loop: Background, tmp_path: Path
) -> None:
    line = "port 8080 is in use: end the other viewer, or choose another port"
    with pytest.raises(InputError, match=f"^{line}$"):
        loop.run(started(tmp_path, alone("unplugged")))


def test_a_start_that_is_interrupted_leaves_no_process(loop: Background, tmp_path: Path) -> None:
    before = set(psutil.Process().children())

    async def body() -> None:
        starting = asyncio.create_task(started(tmp_path, CELL))
        await eventually((tmp_path / "logs" / "cell.log").exists)
        new = set(psutil.Process().children()) - before
        assert new
        starting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await starting
        await eventually(lambda: not any(runs(process.pid) for process in new))

    loop.run(body())
