"""`dlokit stop`: all systems are stopped at once, and an error in one is reported and does not delay the others."""

import asyncio
import itertools
import os
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from buses import bus_of, new_bus

from dlokit.app.operate import stop
from dlokit.app.operate.stop import StopArgs, Stopped, run_stop, stop_all
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.decision.api import STOP_TASK
from dlokit.errors import InputError, SkillFailure
from dlokit.skills.robot import api as robot
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.stop_socket import ENABLE, STOP, press, stop_at_start_file, stop_button, stop_socket
from dlokit.system.toml_config import to_toml

PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long
SOON_S = 0.3  # the wait for an answer that does not come is short
FOUND_S = 3.0  # longer where another answer must come within the same time: a busy machine may take a second
numbers = itertools.count()


class Arm(Component):
    name = "robot"

    def __init__(self, *, hangs: bool) -> None:
        self._hangs = hangs
        self.stopped = asyncio.Event()

    @implements(robot.STOP)
    async def stop(self) -> None:
        if self._hangs:
            await asyncio.Event().wait()
        self.stopped.set()


class Task(Component):
    """A decision component with or without a task."""

    name = "decision"

    def __init__(self, *, runs: bool = True) -> None:
        self._runs = runs
        self.ended = asyncio.Event()

    @implements(STOP_TASK)
    async def stop_task(self) -> bool:
        self.ended.set()
        return self._runs


def noted(folder: Path, *, arms: int = 1) -> RunningSystem:
    folder.mkdir()
    (folder / CONFIG_FILE).write_text(to_toml(RunConfig(arms=2 if arms == 2 else 1)), encoding="utf-8")
    bus = new_bus()
    return RunningSystem(
        pid=os.getpid(),
        began_s=0.0,
        folder=str(folder),
        namespace=bus.namespace,
        endpoint=bus.endpoint,
        key=bus.key,
    )


@asynccontextmanager
async def on_bus(system: RunningSystem, *components: Component) -> AsyncGenerator[None]:
    transport = ZenohTransport(bus_of(system).first())
    host = Container(transport, LoopClock())
    for component in components:
        host.add(component)
    try:
        async with host:
            yield
    finally:  # a session that stays open keeps its process from ending
        await transport.close()


async def stopped(
    systems: Sequence[RunningSystem], within_s: float = PATIENCE_S, found_within_s: float = SOON_S
) -> list[Stopped]:
    return await stop_all(systems, found_within_s=found_within_s, stopped_within_s=within_s)


def test_the_arm_brakes_and_the_task_is_requested_to_end(tmp_path: Path) -> None:
    async def body() -> None:
        system, arm, task = noted(tmp_path / "run"), Arm(hangs=False), Task()
        async with asyncio.timeout(PATIENCE_S), on_bus(system, arm, task):
            [said] = await stopped([system], found_within_s=PATIENCE_S)
        assert task.ended.is_set()
        assert arm.stopped.is_set()
        assert said == Stopped(stands=True, text="the first arm succeeded; its task is ending")

    asyncio.run(body())


def test_a_system_between_two_tasks_has_no_task_to_end(tmp_path: Path) -> None:
    async def body() -> None:
        system = noted(tmp_path / "run")
        async with asyncio.timeout(PATIENCE_S), on_bus(system, Arm(hangs=False), Task(runs=False)):
            [said] = await stopped([system], found_within_s=PATIENCE_S)
        assert said == Stopped(stands=True, text="the first arm succeeded; it has no task to end")

    asyncio.run(body())


def test_systems_that_do_not_respond_do_not_delay_the_stop_of_others(tmp_path: Path) -> None:
    async def body() -> None:
        gone, hanging, well = (noted(tmp_path / name) for name in ("gone", "hanging", "well"))
        arm, said = Arm(hangs=False), asyncio.Queue[str]()
        async with asyncio.timeout(PATIENCE_S), on_bus(hanging, Arm(hangs=True)), on_bus(well, arm, Task(runs=False)):
            systems = [gone, hanging, well]
            stopping = asyncio.create_task(
                stop_all(systems, found_within_s=PATIENCE_S, stopped_within_s=PATIENCE_S, say=said.put_nowait)
            )
            assert await said.get() == f"{well.folder}: the first arm succeeded"
            assert await said.get() == f"{well.folder}: it has no task to end"
            assert arm.stopped.is_set()
            assert not stopping.done()
            stopping.cancel()
            await asyncio.wait({stopping})

    asyncio.run(body())


def test_an_arm_that_is_not_there_and_one_that_hangs_are_reported(tmp_path: Path) -> None:
    async def body() -> None:
        gone, hanging = (noted(tmp_path / name) for name in ("gone", "hanging"))
        async with asyncio.timeout(PATIENCE_S), on_bus(hanging, Arm(hangs=True)):
            [of_gone] = await stopped([gone])
            [of_hanging] = await stopped([hanging], within_s=SOON_S, found_within_s=PATIENCE_S)
        assert not of_gone.stands
        assert of_gone.text.startswith("the first arm is unreachable")
        assert of_hanging == Stopped(stands=False, text=f"it did not answer within {SOON_S:g} s")

    asyncio.run(body())


def test_a_system_that_cannot_be_reached_is_reported(tmp_path: Path) -> None:
    async def body() -> None:
        broken = RunningSystem(pid=1, began_s=0.0, folder=str(tmp_path), namespace="a//b", endpoint="nowhere")
        [said] = await stopped([broken])
        assert not said.stands
        assert said.text.startswith("the request failed: ")

    asyncio.run(body())


def test_a_missing_second_arm_does_not_count_as_stopped(tmp_path: Path) -> None:
    async def body() -> None:
        system = noted(tmp_path / "run", arms=2)
        async with asyncio.timeout(PATIENCE_S), on_bus(system, Arm(hangs=False)):
            [said] = await stopped([system], found_within_s=FOUND_S)
        assert not said.stands
        assert "the first arm succeeded; the second arm is unreachable" in said.text

    asyncio.run(body())


@pytest.mark.parametrize(("stands", "code"), [((True, True), 0), ((True, False), 3)])
def test_each_system_has_a_line_and_the_exit_code_shows_whether_all_arms_stopped(
    stands: tuple[bool, ...],
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def told(systems: Sequence[RunningSystem], say: Callable[[str], None]) -> list[Stopped]:
        for system, one in zip(systems, stands, strict=True):
            say(f"{system.folder}: stands: {one}")
        return [Stopped(stands=one, text="") for one in stands]

    systems = [noted(tmp_path / name) for name in ("one", "two")]
    monkeypatch.setattr(stop, "running_systems", lambda starting: systems)
    monkeypatch.setattr(stop, "stop_all", told)
    assert run_stop(StopArgs()) == code
    assert capsys.readouterr().out == f"{tmp_path / 'one'}: stands: True\n{tmp_path / 'two'}: stands: {stands[1]}\n"


def test_without_a_running_system_there_is_nothing_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop, "running_systems", lambda starting: [])
    with pytest.raises(InputError, match="nothing to stop"):
        run_stop(StopArgs())


def test_an_arm_is_stopped_through_its_process_socket_if_the_bus_does_not_respond(tmp_path: Path) -> None:
    async def body() -> None:
        system, pressed = noted(tmp_path / "run"), asyncio.Event()

        async def press_stop() -> None:
            pressed.set()

        async with stop_button(stop_socket(tmp_path / "run", ""), press_stop, press_stop):
            [said] = await stopped([system], found_within_s=FOUND_S)
        assert pressed.is_set()
        assert said.text.startswith(
            "the first arm stands, and is stopped until dlokit enable; its decision process does not"
        )
        assert not said.stands  # the task is not known to end

    asyncio.run(body())


def test_a_stop_that_feedback_does_not_confirm_is_not_confirmed(tmp_path: Path) -> None:
    async def body() -> None:
        async def fail() -> None:
            raise SkillFailure("not_confirmed", "no feedback")

        socket = stop_socket(tmp_path, "")
        async with stop_button(socket, fail, fail):
            for order in (STOP, ENABLE, b"dance\n"):
                answer = await press(socket, order, PATIENCE_S)
                assert answer is not None
                assert not answer.confirmed
        assert await press(socket, STOP, SOON_S) is None

    asyncio.run(body())


def test_a_system_that_is_still_starting_starts_stopped(tmp_path: Path) -> None:
    async def body() -> None:
        system = msgspec.structs.replace(noted(tmp_path / "run"), starting=True)
        socket, stops = stop_socket(tmp_path / "run", ""), list[str]()

        async def press_stop() -> None:
            stops.append("stop")

        async def enable() -> None:
            stops.append("enable")

        stopping = asyncio.create_task(stopped([system]))
        await asyncio.sleep(SOON_S)
        async with stop_button(socket, press_stop, enable):
            assert stops[0] == "stop"
            [said] = await stopping
            assert said == Stopped(
                stands=True, text="the first arm stands, and is stopped until dlokit enable; it has no task yet"
            )
            await press(socket, ENABLE, PATIENCE_S)
        assert stops[-1] == "enable"
        assert not stop_at_start_file(socket).exists()

    asyncio.run(body())
