"""`dlokit stop`: all systems are stopped at once, and an error in one is reported and does not delay the others."""

import asyncio
import os
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from buses import MemoryBuses, new_bus

from dlokit.app.operate import stop
from dlokit.app.operate.stop import StopArgs, Stopped, run_stop, stop_all
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.decision.api import STOP_TASK
from dlokit.description.arm.mounts import SECOND
from dlokit.errors import CommunicationError, InputError
from dlokit.skills.robot import api as robot
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.processes.bus import JoinBus, JoinedBus
from dlokit.system.processes.first_press import STOP
from dlokit.system.processes.running import RunningSystem
from dlokit.system.processes.stop_socket import Answer, PressStop, stop_at_start_file, stop_socket
from dlokit.system.table import TimeBase

FOUND_S, STOPPED_S, STARTS_S = 2.0, 15.0, 10.0


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
    async def stop_task(self, by: str = "") -> bool:
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
async def on_bus(buses: MemoryBuses, system: RunningSystem, *components: Component) -> AsyncGenerator[None]:
    host = Container(buses.of(system), LoopClock())
    for component in components:
        host.add(component)
    async with host:
        yield


class Sockets:
    """The stop sockets of arms: those with an answer, and those where nobody listens."""

    def __init__(self, answers: dict[Path, Answer] | None = None, *, listens_after_s: float = 0.0) -> None:
        self._answers = answers or {}
        self._listens_after_s = listens_after_s
        self.orders: list[tuple[Path, bytes, float]] = []

    async def press(self, socket: Path, order: bytes, within_s: float, *, starts: bool = False) -> Answer | None:
        self.orders.append((socket, order, within_s))
        if starts:
            await asyncio.sleep(min(within_s, self._listens_after_s))
        return self._answers.get(socket) if within_s > self._listens_after_s else None


async def stopped(
    systems: Sequence[RunningSystem],
    join: JoinBus,
    sockets: Sockets | None = None,
    say: Callable[[str], None] = lambda line: None,
    stopped_within_s: float = STOPPED_S,
    ending: Callable[[RunningSystem], bool] = lambda system: False,
) -> list[Stopped]:
    sockets = sockets or Sockets()
    return await stop_all(systems, FOUND_S, stopped_within_s, STARTS_S, say, join, sockets.press, ending)


def test_the_arm_brakes_and_the_task_is_requested_to_end(tmp_path: Path) -> None:
    async def body() -> None:
        buses, system, arm, task = MemoryBuses(), noted(tmp_path / "run"), Arm(hangs=False), Task()
        async with on_bus(buses, system, arm, task):
            [said] = await stopped([system], buses.join)
        assert task.ended.is_set()
        assert arm.stopped.is_set()
        assert said == Stopped(confirmed=True, text="the first arm succeeded; its task was stopped")

    virtual_time.run(body())


def test_a_system_between_two_tasks_has_no_task_to_end(tmp_path: Path) -> None:
    async def body() -> None:
        buses, system = MemoryBuses(), noted(tmp_path / "run")
        async with on_bus(buses, system, Arm(hangs=False), Task(runs=False)):
            [said] = await stopped([system], buses.join)
        assert said == Stopped(confirmed=True, text="the first arm succeeded; it has no task to end")

    virtual_time.run(body())


def test_systems_that_do_not_respond_do_not_delay_the_stop_of_others(tmp_path: Path) -> None:
    async def body() -> None:
        gone, hanging, well = (noted(tmp_path / name) for name in ("gone", "hanging", "well"))
        buses, arm, said = MemoryBuses(), Arm(hangs=False), asyncio.Queue[str]()
        async with on_bus(buses, hanging, Arm(hangs=True)), on_bus(buses, well, arm, Task(runs=False)):
            began_s = asyncio.get_running_loop().time()
            stopping = asyncio.create_task(stopped([gone, hanging, well], buses.join, say=said.put_nowait))
            assert await said.get() == f"{well.folder}: the first arm succeeded"
            assert await said.get() == f"{well.folder}: it has no task to end"
            assert arm.stopped.is_set()
            assert asyncio.get_running_loop().time() == began_s
            assert not stopping.done()
            assert [each.confirmed for each in await stopping] == [False, False, True]
            assert asyncio.get_running_loop().time() <= began_s + STOPPED_S + 0.1

    virtual_time.run(body())


def test_an_arm_that_is_not_there_and_one_that_hangs_are_reported(tmp_path: Path) -> None:
    async def body() -> None:
        buses = MemoryBuses()
        gone, hanging = (noted(tmp_path / name) for name in ("gone", "hanging"))
        async with on_bus(buses, hanging, Arm(hangs=True)):
            [of_gone, of_hanging] = await stopped([gone, hanging], buses.join, stopped_within_s=FOUND_S + 1.0)
        assert not of_gone.confirmed
        assert of_gone.text.startswith("the first arm is unreachable")
        assert of_hanging == Stopped(confirmed=False, text="it did not answer within 3 s")

    virtual_time.run(body())


def test_a_system_that_cannot_be_reached_is_reported_and_the_others_are_stopped(tmp_path: Path) -> None:
    buses, broken, well = MemoryBuses(), noted(tmp_path / "broken"), noted(tmp_path / "well")

    def join(config: ZenohConfig, time_base: TimeBase, /) -> AbstractAsyncContextManager[JoinedBus]:
        if config.namespace == broken.namespace:
            raise CommunicationError("no such bus")
        return buses.join(config, time_base)

    async def body() -> None:
        async with on_bus(buses, well, Arm(hangs=False), Task()):
            [of_broken, of_well] = await stopped([broken, well], join)
        unreachable = "the first arm is unreachable: press the emergency stop of the arm (no such bus)"
        assert of_broken == Stopped(confirmed=False, text=f"{unreachable}; the request failed: no such bus")
        assert of_well.confirmed

    virtual_time.run(body())


def test_the_error_of_one_arm_does_not_keep_the_other_from_its_stop(tmp_path: Path) -> None:
    first, second = stop_socket(tmp_path / "run", ""), stop_socket(tmp_path / "run", SECOND)

    class FirstForbidden(Sockets):
        async def press(self, socket: Path, order: bytes, within_s: float, *, starts: bool = False) -> Answer | None:
            if socket == first:
                raise PermissionError("not your socket")
            await asyncio.sleep(1.0)
            return await super().press(socket, order, within_s, starts=starts)

    async def body() -> None:
        buses, system = MemoryBuses(), noted(tmp_path / "run", arms=2)
        sockets = FirstForbidden({second: Answer(confirmed=True, text="stands")})
        async with on_bus(buses, system, Task()):
            [said] = await stopped([system], buses.join, sockets)
        assert not said.confirmed
        assert "the first arm is unreachable: press the emergency stop of the arm (not your socket)" in said.text
        assert "the second arm stands; its task was stopped" in said.text

    virtual_time.run(body())


def test_a_missing_second_arm_does_not_count_as_stopped(tmp_path: Path) -> None:
    async def body() -> None:
        buses, system = MemoryBuses(), noted(tmp_path / "run", arms=2)
        async with on_bus(buses, system, Arm(hangs=False)):
            [said] = await stopped([system], buses.join)
        assert not said.confirmed
        assert "the first arm succeeded; the second arm is unreachable" in said.text

    virtual_time.run(body())


@pytest.mark.parametrize(("stands", "code"), [((True, True), 0), ((True, False), 3)])
def test_each_system_has_a_line_and_the_exit_code_shows_whether_all_arms_stopped(
    stands: tuple[bool, ...],
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def told(systems: Sequence[RunningSystem], say: Callable[[str], None], press: PressStop) -> list[Stopped]:
        for system, one in zip(systems, stands, strict=True):
            say(f"{system.folder}: stands: {one}")
        return [Stopped(confirmed=one, text="") for one in stands]

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
        system, socket = noted(tmp_path / "run"), stop_socket(tmp_path / "run", "")
        sockets = Sockets({socket: Answer(confirmed=True, text="stands")})
        [said] = await stopped([system], MemoryBuses().join, sockets)
        assert sockets.orders == [(socket, STOP, FOUND_S)]
        assert said.text.startswith("the first arm stands; its decision process does not")
        assert not said.confirmed  # the task is not known to end

    virtual_time.run(body())


def test_a_stop_that_the_process_does_not_confirm_is_not_confirmed(tmp_path: Path) -> None:
    async def body() -> None:
        buses, system, arm = MemoryBuses(), noted(tmp_path / "run"), Arm(hangs=False)
        sockets = Sockets({stop_socket(tmp_path / "run", ""): Answer(confirmed=False, text="did not answer")})
        async with on_bus(buses, system, arm, Task()):
            [said] = await stopped([system], buses.join, sockets)
        assert said == Stopped(confirmed=False, text="the first arm did not answer; its task was stopped")
        assert not arm.stopped.is_set()  # its own process has the order

    virtual_time.run(body())


@pytest.mark.parametrize(
    ("listens_after_s", "stands", "text"),
    [
        (3.0, True, "the first arm stands; it has no task yet"),
        (60.0, False, "the first arm has not started yet, and will start stopped; it has no task yet"),
    ],
)
def test_a_system_that_is_still_starting_starts_stopped(
    tmp_path: Path, listens_after_s: float, stands: bool, text: str
) -> None:
    async def body() -> None:
        system = msgspec.structs.replace(noted(tmp_path / "run"), starting=True)
        socket = stop_socket(tmp_path / "run", "")
        sockets = Sockets({socket: Answer(confirmed=True, text="stands")}, listens_after_s=listens_after_s)
        [said] = await stopped([system], MemoryBuses().join, sockets)
        assert sockets.orders == [(socket, STOP, STARTS_S)]
        assert said == Stopped(confirmed=stands, text=text)
        assert stop_at_start_file(socket).exists()  # for the process that starts
        stop_at_start_file(socket).unlink()

    virtual_time.run(body())


ARM_AT_REST, NO_ARM = Answer(confirmed=True, text="stands, and is stopped until dlokit enable"), None


@pytest.mark.parametrize(
    ("answer", "confirmed", "text"),
    [
        (ARM_AT_REST, True, "the first arm is at rest; it is ending, and its task has ended"),
        (
            NO_ARM,
            False,
            "the first arm is unreachable: press the emergency stop of the arm; it is ending, and its task has ended",
        ),
    ],
)
def test_a_system_that_is_ending_says_so_and_its_arm_is_at_rest_only_where_feedback_said_so(
    answer: Answer | None, confirmed: bool, text: str, tmp_path: Path
) -> None:
    async def body() -> None:
        system, socket = noted(tmp_path / "run"), stop_socket(tmp_path / "run", "")
        sockets = Sockets({} if answer is None else {socket: answer})
        [said] = await stopped([system], MemoryBuses().join, sockets, ending=lambda system: True)
        assert said == Stopped(confirmed=confirmed, text=text)

    virtual_time.run(body())


def test_a_system_whose_bus_goes_while_it_is_stopped_is_ending(tmp_path: Path) -> None:
    gone = asyncio.Event()

    def join(config: ZenohConfig, time_base: TimeBase, /) -> AbstractAsyncContextManager[JoinedBus]:
        gone.set()
        raise CommunicationError("no such bus")

    async def body() -> None:
        system, socket = noted(tmp_path / "run"), stop_socket(tmp_path / "run", "")
        sockets = Sockets({socket: ARM_AT_REST})
        [said] = await stopped([system], join, sockets, ending=lambda system: gone.is_set())
        assert said.confirmed
        assert said.text.endswith("it is ending, and its task has ended")

    virtual_time.run(body())
