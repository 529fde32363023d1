"""What the page keeps of the messages it receives."""

import msgspec
import pytest

from dlokit import geometry
from dlokit.skills.viewer.state import Received, RunState
from dlokit.types.action import Candidates, Grasp, PickPlace, VelocityProfile
from dlokit.types.flow import FlowStatus, RunOutcome, RunPhase, RunStatus, TaskEnd

FLOW = (("plan", "planned", "grasp"), ("grasp", "done", "converged"))
POSE = geometry.downward((0.4, 0.0, 0.1), 0.0)
ACTION = PickPlace(stamp_ns=2, grasp=Grasp(node=3, T_world_tcp=POSE), path=(POSE,), velocity=VelocityProfile())
CANDIDATES = Candidates(stamp_ns=3, rollouts=16, budget=480)
ENDED = TaskEnd(number=1, goal="S", outcome=RunOutcome.CONVERGED, text="", actions=1, rmse_m=0.005, threshold_m=0.012)


@pytest.fixture
def seen() -> Received:
    received = Received(FLOW)
    received.record_candidates(CANDIDATES)
    received.action.put(ACTION)
    return received


def _status(step: str, outcome: RunOutcome | None = None) -> FlowStatus:
    return FlowStatus(stamp_ns=4, flow="shape", step=step, actions=1, rmse_m=0.03, outcome=outcome)


def test_an_action_that_was_not_drawn_before_the_next_decision_is_not_drawn(seen: Received) -> None:
    assert seen.action.is_new
    seen.record_candidates(CANDIDATES)
    assert (seen.action.value, seen.candidates.value) == (None, CANDIDATES)


def test_after_a_task_neither_its_action_nor_its_candidates_are_drawn(seen: Received) -> None:
    seen.record_flow(_status("grasp"))
    assert (seen.action.value, seen.candidates.value) == (ACTION, CANDIDATES)
    seen.record_flow(_status("converged", RunOutcome.CONVERGED))
    assert (seen.action.value, seen.candidates.value) == (None, None)


def test_the_end_of_a_task_is_reported_once_and_again_when_its_files_are_known(seen: Received) -> None:
    def run(end: TaskEnd) -> RunStatus:
        return RunStatus(stamp_ns=5, phase=RunPhase.WAITING, last=end)

    assert seen.record_run(run(ENDED)) is ENDED
    assert seen.record_run(run(ENDED)) is None
    with_files = msgspec.structs.replace(ENDED, files=("report.html",))
    assert seen.record_run(run(with_files)) is with_files
    assert seen.end.value is with_files


def test_the_run_decides_the_state_and_without_its_status_the_flow_does(seen: Received) -> None:
    seen.record_flow(_status("plan"))
    assert seen.run_state is RunState.RUNNING
    seen.record_run(RunStatus(stamp_ns=5, phase=RunPhase.PAUSED))
    seen.record_flow(_status("grasp"))
    assert seen.run_state is RunState.PAUSED


def test_the_status_of_the_flow_is_drawn_again_when_the_run_is_paused(seen: Received) -> None:
    seen.record_flow(_status("plan"))
    assert seen.status.take(lambda _: None)
    seen.record_run(RunStatus(stamp_ns=5, phase=RunPhase.PAUSED))
    assert seen.status.is_new


def test_the_end_of_an_earlier_task_is_not_shown_while_the_next_one_ends(seen: Received) -> None:
    shown: list[bool] = []
    for phase, task in (
        (RunPhase.WAITING, 1),
        (RunPhase.RUNNING, 2),
        (RunPhase.FINISHING, 2),
    ):
        seen.record_run(RunStatus(stamp_ns=5, phase=phase, task=task, last=ENDED))
        shown.append(seen.between_tasks)
    second = msgspec.structs.replace(ENDED, number=2)
    seen.record_run(RunStatus(stamp_ns=6, phase=RunPhase.FINISHING, task=2, last=second))
    assert [*shown, seen.between_tasks] == [True, False, False, True]


def test_the_end_is_drawn_again_when_the_run_ends_its_processes(seen: Received) -> None:
    seen.record_run(RunStatus(stamp_ns=5, phase=RunPhase.WAITING, task=1, last=ENDED))
    assert seen.end.take(lambda _: None)
    seen.record_run(RunStatus(stamp_ns=6, phase=RunPhase.ENDED, task=1, last=ENDED))
    assert seen.end.is_new
