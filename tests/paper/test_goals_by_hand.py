"""Runs whose goals the operator sets, one after the other: as curves, or by showing a shape to the camera."""

import asyncio
from collections.abc import Callable

import pytest
from ideal_lab import PATIENT, I, S, lab, running
from scripted_hardware import Lab

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.api import SEE_GOAL, STOP_TASK
from dlokit.description.shapes import moved
from dlokit.geometry import rmse_m
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_result import RunRecord
from dlokit.system.shaping import Watcher, shape_until_ended
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import Command, OperatorCommand, RunOutcome, RunPhase, RunStatus, TaskEnd
from dlokit.types.outcome import Failed, Outcome, Succeeded

Deed = Callable[[Lab], OperatorCommand]
"""What a person does while the run waits for a goal: something to the DLO, and a command."""
UNANSWERED = frozenset({Command.STOP})
"""Commands that change nothing in a run that waits for a goal: the person goes on to the next deed."""


def start(goal: Float64Array | None = None, name: str = "") -> Deed:
    return lambda lab: OperatorCommand(stamp_ns=1, command=Command.START, nodes_world=goal, goal=name)


def press(command: Command) -> Deed:
    return lambda lab: OperatorCommand(stamp_ns=1, command=command)


def move_dlo(nodes: Float64Array, then: Command) -> Deed:
    def deed(lab: Lab) -> OperatorCommand:
        lab.nodes = nodes.copy()
        return OperatorCommand(stamp_ns=1, command=then)

    return deed


class Person(Component):
    name = "viewer"
    publishes = (topics.COMMAND,)
    reads = (topics.RUN,)

    def __init__(self, lab: Lab, deeds: tuple[Deed, ...]) -> None:
        self._lab, self._deeds = lab, list(deeds)
        self.statuses: list[RunStatus] = []

    async def run(self) -> None:
        async for status in self.port.stream(topics.RUN):
            self.statuses.append(status)
            if status.phase is RunPhase.WAITING and self._deeds:
                await self.port.clock.sleep(0.2)
                while True:
                    command = self._deeds.pop(0)(self._lab)
                    self.port.publish(topics.COMMAND, command)
                    if command.command not in UNANSWERED:
                        break


class Records(Watcher):
    def __init__(self) -> None:
        self.records: list[RunRecord] = []

    async def ended(self, number: int, record: RunRecord) -> TaskEnd:
        self.records.append(record)
        return await super().ended(number, record)


def a_run(lab: Lab, *deeds: Deed, shown: bool = False) -> tuple[list[RunRecord], list[RunStatus]]:
    """The records of a run that takes goals until the person ends it, and its statuses."""

    async def main() -> tuple[list[RunRecord], list[RunStatus]]:
        bus, clock, watch = MemoryTransport(), LoopClock(), Records()
        person = Person(lab, deeds)
        job = ShapeJob(name="by hand", start_nodes_world=lab.nodes, request=None, shown=shown, stays=True)
        async with running(lab, bus, clock, PATIENT, others=(person,)) as host:
            last = await shape_until_ended(host, RunConfig(task=PATIENT), job, watch)
            await clock.sleep(0.1)
        assert last.actions is watch.records[-1].actions
        assert [(task.number, task.goal, task.outcome) for task in last.result.tasks] == [
            (record.result.task, record.result.goal, record.result.outcome) for record in watch.records
        ]
        return watch.records, person.statuses

    return virtual_time.run(main())


BESIDE = moved(I, (0.05, 0.0))


def test_a_run_takes_one_goal_after_the_other_until_the_operator_ends_it() -> None:
    records, statuses = a_run(lab(I), start(BESIDE, "beside"), start(I, "lab/back.csv"), press(Command.END))
    assert [record.result.outcome for record in records] == [RunOutcome.CONVERGED] * 2
    assert [record.result.goal for record in records] == ["beside", "back.csv"]
    assert [record.result.task for record in records] == [1, 2]
    assert all(record.result.tasks == () for record in records)  # the list is in the file of the run
    ends = {status.last.number: status.last for status in statuses if status.last is not None}
    assert [(end.goal, end.outcome) for end in ends.values()] == [
        ("beside", RunOutcome.CONVERGED),
        ("back.csv", RunOutcome.CONVERGED),
    ]
    assert statuses[-1].phase is RunPhase.ENDED


def test_nothing_moves_between_two_tasks_before_the_operators_start() -> None:
    here = lab(I)
    calls: list[list[str]] = []

    def looks_at_the_calls(lab: Lab) -> OperatorCommand:
        calls.append(list(lab.calls))
        return OperatorCommand(stamp_ns=1, command=Command.END)

    a_run(here, start(BESIDE), looks_at_the_calls)
    assert calls == [here.calls]


def test_a_dlo_that_a_person_moved_between_two_tasks_is_found_where_it_is() -> None:
    here = lab(I)

    def moves_and_starts(lab: Lab) -> OperatorCommand:
        lab.nodes = moved(S, (0.08, 0.05))
        return OperatorCommand(stamp_ns=1, command=Command.START, nodes_world=BESIDE)

    records, _ = a_run(here, start(BESIDE), moves_and_starts, press(Command.END))
    first_seen = records[1].start_nodes_world
    assert first_seen is not None
    expected = moved(S, (0.08, 0.05))
    assert min(rmse_m(first_seen, nodes) for nodes in (expected, expected[::-1])) < 0.005  # the camera's fit: 1 to 3 mm
    assert records[1].result.outcome is RunOutcome.CONVERGED


def test_a_shape_that_was_shown_and_moved_away_is_brought_back() -> None:
    here = lab(BESIDE)
    records, _ = a_run(here, move_dlo(I, Command.START), press(Command.END), shown=True)
    (record,) = records
    assert (record.result.goal, record.result.outcome) == ("seen", RunOutcome.CONVERGED)
    # The threshold, and the error of the look that gave the goal: 1 to 3 mm.
    assert min(rmse_m(here.nodes, nodes) for nodes in (BESIDE, BESIDE[::-1])) < PATIENT.threshold_m + 0.003


def test_a_goal_is_shown_between_two_tasks_and_a_look_that_fails_is_named() -> None:
    here = lab(I)

    def covers_the_camera(lab: Lab) -> OperatorCommand:
        lab.fails["look"] = ["no_points"]
        return OperatorCommand(stamp_ns=1, command=Command.SEE)

    records, statuses = a_run(
        here,
        start(BESIDE),
        covers_the_camera,
        press(Command.SEE),
        move_dlo(I, Command.START),
        press(Command.END),
    )
    notices = [status.notice for status in statuses if status.phase is RunPhase.WAITING and status.notice]
    assert len(notices) == 1
    assert "no_points" in notices[0]
    # What was shown is what the first task had left.
    goal = records[1].goal_nodes_world
    assert min(rmse_m(goal, nodes) for nodes in (BESIDE, BESIDE[::-1])) < PATIENT.threshold_m + 0.003


def test_a_stop_while_a_goal_is_awaited_does_not_end_the_run() -> None:
    records, _ = a_run(lab(I), press(Command.STOP), start(I), press(Command.END))
    assert [record.result.outcome for record in records] == [RunOutcome.CONVERGED]


def test_ending_a_run_before_its_first_goal_is_a_cancelled_task() -> None:
    records, statuses = a_run(lab(I), press(Command.END))
    assert [record.result.outcome for record in records] == [RunOutcome.CANCELLED]
    assert not records[0].goal_set
    assert statuses[-1].phase is RunPhase.ENDED


@pytest.mark.parametrize("fails", [False, True])
def test_showing_a_goal_is_a_skill(fails: bool) -> None:
    async def main() -> None:
        bus, here = MemoryTransport(), lab(S)
        here.fails["look"] = ["no_points"] if fails else []
        async with running(here, bus, LoopClock()):
            seen = await bus.call(SEE_GOAL)
            if fails:
                assert isinstance(seen, Failed)
                assert seen.reason == "no_points"
            else:
                assert isinstance(seen, Succeeded)
                assert min(rmse_m(seen.result.nodes_world, nodes) for nodes in (S, S[::-1])) < 0.005

    virtual_time.run(main())


@pytest.mark.parametrize("tasks_before", [0, 1])
def test_a_stop_from_a_terminal_leaves_a_run_that_waits_for_a_goal_waiting(tasks_before: int) -> None:
    said = list[Outcome[bool]]()

    class Terminal(Component):
        """Stops a waiting run; then the operator goes on from the page, and ends the run there."""

        name = "viewer"
        publishes = (topics.COMMAND,)
        reads = (topics.RUN,)

        async def run(self) -> None:
            tasks = 0
            async for status in self.port.stream(topics.RUN):
                if status.phase is not RunPhase.WAITING:
                    continue
                if tasks == tasks_before:
                    said.append(await self.port.call(STOP_TASK))
                deed = press(Command.END) if tasks > tasks_before else start(BESIDE)
                self.port.publish(topics.COMMAND, deed(here))
                tasks += 1

    here = lab(I)

    async def main() -> list[RunRecord]:
        bus, clock, watch = MemoryTransport(), LoopClock(), Records()
        job = ShapeJob(name="by hand", start_nodes_world=here.nodes, request=None, stays=True)
        async with running(here, bus, clock, PATIENT, others=(Terminal(),)) as host:
            await shape_until_ended(host, RunConfig(task=PATIENT), job, watch)
        return watch.records

    records = virtual_time.run(main())
    assert [isinstance(one, Succeeded) and one.result for one in said] == [False]
    assert [record.result.outcome for record in records] == [RunOutcome.CONVERGED] * (tasks_before + 1)


def test_a_stop_from_a_terminal_ends_the_running_task_and_the_run_takes_the_next_goal() -> None:
    said = list[Outcome[bool]]()

    class Terminal(Component):
        name = "terminal"
        reads = (topics.FLOW,)

        async def run(self) -> None:
            async for status in self.port.stream(topics.FLOW):
                if status.step == "choose_grasp":
                    said.append(await self.port.call(STOP_TASK))
                    return

    here = lab(I)

    async def main() -> list[RunRecord]:
        bus, clock, watch = MemoryTransport(), LoopClock(), Records()
        job = ShapeJob(name="by hand", start_nodes_world=here.nodes, request=None, stays=True)
        person = Person(here, (start(BESIDE), start(BESIDE), press(Command.END)))
        async with running(here, bus, clock, PATIENT, others=(person, Terminal())) as host:
            await shape_until_ended(host, RunConfig(task=PATIENT), job, watch)
        return watch.records

    records = virtual_time.run(main())
    assert [isinstance(one, Succeeded) and one.result for one in said] == [True]
    assert [record.result.outcome for record in records] == [RunOutcome.CANCELLED, RunOutcome.CONVERGED]


def test_stopping_a_run_while_the_files_of_a_task_are_written_loses_none_of_them() -> None:
    async def main() -> None:
        bus, clock, here = MemoryTransport(), LoopClock(), lab(I)
        writing = asyncio.Event()

        class Slow(Records):
            async def ended(self, number: int, record: RunRecord) -> TaskEnd:
                writing.set()
                await clock.sleep(1.0)
                return await super().ended(number, record)

        job = ShapeJob(name="by hand", start_nodes_world=here.nodes, request=None, stays=True)
        person, watch = Person(here, (start(BESIDE),)), Slow()
        async with running(here, bus, clock, PATIENT, others=(person,)) as host:
            run = asyncio.create_task(shape_until_ended(host, RunConfig(task=PATIENT), job, watch))
            await writing.wait()
            run.cancel()
            assert (await run).actions is watch.records[0].actions
        assert watch.records[0].result.outcome is RunOutcome.CONVERGED

    virtual_time.run(main())


def test_after_a_stopped_task_the_fingers_open_before_the_arm_moves_home() -> None:
    async def main() -> tuple[list[str], list[RunOutcome]]:
        bus, clock, watch, here = MemoryTransport(), LoopClock(), Records(), lab(I)

        class StopsOnce(Component):
            name = "viewer"
            publishes = (topics.COMMAND,)
            reads = (topics.RUN, topics.FLOW)

            def __init__(self) -> None:
                super().__init__()
                self.deeds = [start(BESIDE), start(I), press(Command.END)]

            async def run(self) -> None:
                stopping = asyncio.create_task(self._stop())
                async for status in self.port.stream(topics.RUN):
                    if status.phase is RunPhase.WAITING and self.deeds:
                        await self.port.clock.sleep(0.2)
                        here.calls.append(f"start {len(self.deeds)}")
                        self.port.publish(topics.COMMAND, self.deeds.pop(0)(here))
                await stopping

            async def _stop(self) -> None:
                async for status in self.port.stream(topics.FLOW):
                    if status.step == "move_to_goal":
                        self.port.publish(topics.COMMAND, press(Command.STOP)(here))
                        return

        job = ShapeJob(name="by hand", start_nodes_world=here.nodes, request=None, stays=True)
        async with running(here, bus, clock, PATIENT, others=(StopsOnce(),)) as host:
            await shape_until_ended(host, RunConfig(task=PATIENT), job, watch)
        return here.calls, [record.result.outcome for record in watch.records]

    calls, outcomes = virtual_time.run(main())
    assert outcomes[0] is RunOutcome.CANCELLED
    after = calls[calls.index("start 2") + 1 :]
    assert after.index("release") < after.index("home")
