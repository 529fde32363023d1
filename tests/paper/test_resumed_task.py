"""A task whose process crashed continues from its journal, with the same goal and the remaining budget."""

from pathlib import Path

import numpy as np
import pytest
from ideal_lab import LENGTH_M, NODES, PATIENT, Lab, running

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.config import TaskConfig
from dlokit.decision.journal import Journal
from dlokit.decision.records import ActionRecord, GoalRequest, ShapeResult
from dlokit.description.shapes import builtin_shape
from dlokit.errors import InputError
from dlokit.recording.disk import Disk
from dlokit.system.build import decision_of
from dlokit.system.results.run_folder import JOURNAL_FILE, JournalFile, read_journal
from dlokit.types.flow import RunOutcome

I = builtin_shape("I", LENGTH_M, NODES)  # noqa: E741  the shape's name
GOAL = I + np.array([0.05, 0.0, 0.0])


class Run:
    """One process's part of a task, with its journal."""

    def __init__(self, lab: Lab, config: TaskConfig, resumed: Journal | None = None) -> None:
        self.lab = lab
        self.journals: list[Journal] = []
        self.records: list[ActionRecord] = []
        self.steps: list[str] = []
        self.result: ShapeResult = virtual_time.run(self._run(config, resumed))

    async def _run(self, config: TaskConfig, resumed: Journal | None) -> ShapeResult:
        transport, clock = MemoryTransport(), LoopClock()
        async with running(self.lab, transport, clock, config, keep=self.journals.append) as host:
            request = GoalRequest(nodes_world=GOAL, name="I, moved") if resumed is None else resumed.request
            return await decision_of(host).shape(
                request, self.records.append, lambda status: self.steps.append(status.step), resumed=resumed
            )


@pytest.fixture(scope="module")
def cut_off() -> Run:
    """A task that ends after one action, far from its goal."""
    return Run(Lab(nodes=I.copy()), TaskConfig(max_actions=1))


def test_a_journal_is_written_at_each_step_once_there_is_a_goal(cut_off: Run) -> None:
    assert len(cut_off.journals) == len(cut_off.steps) - 1  # the end is not a step
    assert [journal.actions for journal in cut_off.journals] == sorted(journal.actions for journal in cut_off.journals)
    last = cut_off.journals[-1]
    assert last.actions == 1
    assert last.errors_m[-1] == cut_off.result.rmse_m
    assert last.elapsed_s > 0.0


def test_the_resumed_task_takes_the_arm_observes_again_and_continues_counting(cut_off: Run) -> None:
    resumed = Run(Lab(nodes=cut_off.lab.nodes), TaskConfig(max_actions=3), cut_off.journals[-1])
    assert resumed.steps[:3] == ["take_over", "check_camera", "find_dlo"]
    assert resumed.lab.calls[:3] == ["recover", "release", "move_linear"]
    assert resumed.result.outcome is RunOutcome.BUDGET
    assert [record.action for record in resumed.records] == [2, 3]
    assert resumed.result.start_rmse_m == cut_off.result.start_rmse_m
    # Observed again, the rope has the same shape.
    assert resumed.journals[-1].errors_m[1] == pytest.approx(cut_off.journals[-1].errors_m[1], abs=2e-3)


def test_used_budgets_stay_used(cut_off: Run) -> None:
    spent = Run(Lab(nodes=cut_off.lab.nodes), TaskConfig(max_actions=1), cut_off.journals[-1])
    assert spent.result.outcome is RunOutcome.BUDGET
    assert spent.records == []
    late = Run(
        Lab(nodes=cut_off.lab.nodes), TaskConfig(max_time_s=cut_off.journals[-1].elapsed_s), cut_off.journals[-1]
    )
    assert late.result.outcome is RunOutcome.BUDGET


def test_after_a_crash_before_the_first_observation_the_task_starts_from_the_beginning(cut_off: Run) -> None:
    first = cut_off.journals[0]
    assert first.errors_m == ()
    again = Run(Lab(nodes=I.copy()), TaskConfig(max_actions=1), first)
    assert again.records[0].action == 1


def test_a_task_resumes_from_a_dlo_that_was_dropped_across_itself(cut_off: Run) -> None:
    # Straight, three quarters of a turn, and straight again, across the first part.
    heading = 1.5 * np.pi * np.clip(np.linspace(-0.5, 1.5, NODES - 1), 0.0, 1.0)
    loop = np.tile(I[NODES // 2], (NODES, 1))
    loop[1:, :2] += LENGTH_M / (NODES - 1) * np.cumsum(np.column_stack((np.sin(heading), np.cos(heading))), axis=0)
    looked_once = next(journal for journal in cut_off.journals if journal.errors_m)
    assert looked_once.actions == 0
    assert Run(Lab(nodes=loop.copy()), TaskConfig(max_actions=1)).result.outcome is RunOutcome.INFEASIBLE
    resumed = Run(Lab(nodes=loop.copy()), TaskConfig(max_actions=1), looked_once)
    assert [record.action for record in resumed.records] == [1]


def test_an_arm_that_cannot_be_recovered_ends_the_task_by_name(cut_off: Run) -> None:
    result = Run(Lab(nodes=I.copy(), fails={"recover": ["fault"]}), PATIENT, cut_off.journals[-1]).result
    assert result.outcome is RunOutcome.FAILED
    assert result.reason is not None
    assert result.reason.startswith("robot.recover fault")


def test_the_file_contains_the_last_journal(cut_off: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="dlokit shape --config"):
        read_journal(tmp_path)
    disk = Disk()
    file = JournalFile(tmp_path, disk)
    for journal in cut_off.journals:
        file.keep(journal)
    assert disk.settle()
    read, last = read_journal(tmp_path), cut_off.journals[-1]
    assert read.errors_m == last.errors_m
    assert read.slips == last.slips
    np.testing.assert_array_equal(read.request.nodes_world, last.request.nodes_world)
    assert [mark.node for mark in read.marks] == [mark.node for mark in last.marks]
    (tmp_path / "taken").touch()
    JournalFile(tmp_path / "taken", disk).keep(last)  # a disk error does not end the task
    assert disk.settle()
    assert list(disk.failures) == [JOURNAL_FILE]
    (tmp_path / JOURNAL_FILE).write_bytes(b"\x00")
    with pytest.raises(InputError, match="cannot be read"):
        read_journal(tmp_path)
