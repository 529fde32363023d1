"""How a task ends or goes on where the paper has no arrow: failures, an arm that braked, budgets, the operator."""

import logging

import pytest
from ideal_lab import I, S, lab, shape

from dlokit.decision import component
from dlokit.decision.config import TaskConfig
from dlokit.decision.steps import hands
from dlokit.decision.steps.hands import MOST_RECOVERIES
from dlokit.decision.task import ShapeTask
from dlokit.description.shapes import moved
from dlokit.types.flow import Command, FlowStatus, RunOutcome


@pytest.mark.parametrize(
    ("skill", "reason", "edge"),
    [
        ("look", "camera_lost", ("find_dlo", "failed", "failed")),
        ("look", "no_points", ("find_dlo", "unusable", "infeasible")),
        ("home", "robot_lost", ("find_dlo", "failed", "failed")),
        ("move_to", "robot_lost", ("approach", "failed", "failed")),
        ("move_linear", "robot_lost", ("grasp", "failed", "failed")),
        ("grasp", "robot_lost", ("grasp", "failed", "failed")),
        ("follow_path", "stopped", ("move_to_goal", "failed", "failed")),
    ],
)
def test_a_failing_skill_ends_the_task_with_its_name_and_a_safe_robot(
    skill: str, reason: str, edge: tuple[str, str, str]
) -> None:
    broken = lab(I)
    broken.fails[skill] = [reason]
    trace = shape(broken, S)
    assert edge in trace.edges()
    assert trace.result.reason is not None
    assert reason in trace.result.reason
    assert ("by robot.stop" in trace.result.reason) == (reason == "stopped")
    if trace.result.outcome is RunOutcome.FAILED:
        assert trace.calls[-2:] == ["halt", "tracking 0"]


@pytest.mark.parametrize(
    ("skill", "box"),
    [("move_to", "approach"), ("move_linear", "grasp"), ("follow_path", "move_to_goal"), ("release", "approach")],
)
def test_an_arm_that_braked_by_itself_is_cleared_lets_go_and_the_task_goes_on(skill: str, box: str) -> None:
    late = lab(I)
    late.fails[skill] = ["lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert (box, "interrupted", "recover") in trace.edges()
    assert ("recover", "done", "release") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_an_action_interrupted_before_its_grasp_does_not_count_as_held() -> None:
    late = lab(I)
    late.fails["move_to"] = ["", "lost_commander"]  # the first action is whole, the second ends on the way
    trace = shape(late, S, TaskConfig(max_actions=2))
    assert [record.grasp_ok for record in trace.result.history] == [True, False]


def test_an_arm_that_braked_by_itself_before_the_first_look_is_told_again_to_drive_out_of_the_picture() -> None:
    late = lab(I)
    late.fails["home"] = ["lease_lost", "lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert trace.calls.count("recover") == 2
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_an_arm_that_never_gets_home_fails_the_task_by_name() -> None:
    late = lab(I)
    late.fails["home"] = ["lease_lost"] * (MOST_RECOVERIES + 1)
    trace = shape(late, S)
    assert trace.result.outcome is RunOutcome.FAILED
    assert trace.result.reason is not None
    assert "lease_lost" in trace.result.reason


def test_an_arm_that_brakes_again_and_again_fails_the_task_by_name() -> None:
    late = lab(I)
    late.fails["move_to"] = ["lost_commander"] * (MOST_RECOVERIES + 1)
    trace = shape(late, S)
    assert ("recover", "too_often", "failed") in trace.edges()
    assert trace.result.reason is not None
    assert "lost_commander" in trace.result.reason


def test_an_arm_whose_fault_does_not_clear_fails_the_task() -> None:
    broken = lab(I)
    broken.fails = {"move_to": ["lost_commander"], "recover": ["robot_lost"]}
    assert ("recover", "failed", "failed") in shape(broken, S).edges()


def test_a_release_that_is_interrupted_is_done_again() -> None:
    late = lab(I)
    late.fails["release"] = ["", "lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert ("release", "interrupted", "recover") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_a_camera_lost_between_actions_fails_the_task() -> None:
    broken = lab(I)
    seen_before = 3  # one to find the rope and two to see that it rests
    broken.fails["look"] = [""] * seen_before + ["camera_lost"]
    trace = shape(broken, S)
    assert ("track_again", "failed", "failed") in trace.edges()


def test_a_rope_out_of_reach_at_the_start_is_infeasible() -> None:
    trace = shape(lab(moved(I, (0.32, 0.0))), I)
    assert ("track_model", "unusable", "infeasible") in trace.edges()


def test_the_action_budget_ends_the_task() -> None:
    trace = shape(lab(I), S, TaskConfig(max_actions=1, threshold_m=1e-4, infeasible="try"))
    assert ("compare", "out_of_actions", "budget_spent") in trace.edges()
    assert trace.result.outcome is RunOutcome.BUDGET
    assert trace.result.reason is not None
    assert "best RMSE" in trace.result.reason


def test_the_time_budget_ends_the_task() -> None:
    trace = shape(lab(I), S, TaskConfig(max_time_s=1.0, threshold_m=1e-4, infeasible="try"))
    assert ("compare", "out_of_time", "budget_spent") in trace.edges()


def test_a_threshold_set_too_low_stalls_instead_of_refining_for_ever() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(stall_actions=2, threshold_m=1e-4, infeasible="try"))
    assert ("compare", "stalled", "stalled") in trace.edges()


def test_a_task_ends_when_the_planner_promises_no_gain_after_actions_in_vain() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    # A goal so near that no action of the model's rod brings it nearer by `PROGRESS_M`.
    trace = shape(stubborn, moved(I, (0.002, 0.0)), TaskConfig(hopeless_actions=2, threshold_m=5e-4, infeasible="try"))
    assert ("choose_grasp", "no_gain", "stalled") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert len(trace.result.history) == 2
    assert trace.result.reason is not None
    assert "best RMSE" in trace.result.reason


def test_the_operator_stops_the_task_and_the_robot_is_left_safe() -> None:
    def presses_stop(status: FlowStatus) -> Command | None:
        return Command.STOP if status.step == "approach" else None

    trace = shape(lab(I), S, operator=presses_stop)
    assert trace.result.outcome is RunOutcome.CANCELLED
    assert trace.result.reason == "stopped by the viewer's Stop button"
    assert trace.calls[-2:] == ["stop", "tracking 0"]


def test_the_time_that_the_operator_takes_is_no_computing() -> None:
    waited_s = 20.0

    def sets_the_goal(status: FlowStatus) -> Command | None:
        return Command.START if status.step == "set_goal" else None

    result = shape(lab(I), None, operator=sets_the_goal, operator_takes_s=waited_s).result
    (operator,) = [visit for visit in result.timings if visit.step == "operator"]
    assert operator.cell_s == pytest.approx(waited_s, abs=0.1)
    assert operator.machine_s == 0.0
    assert all(visit.cell_s < waited_s / 2 for visit in result.timings if visit.step == "set_goal")


def test_a_flow_that_raises_brakes_the_arm_before_the_log_line(monkeypatch: pytest.MonkeyPatch) -> None:
    broken, called = lab(I), list[bool]()

    async def raises(task: ShapeTask) -> None:
        raise RuntimeError("a mistake of ours")

    class Looks(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            called.append("halt" in broken.calls)

    handler = Looks(level=logging.ERROR)
    monkeypatch.setattr(hands, "go_above", raises)
    component.log.addHandler(handler)
    try:
        trace = shape(broken, S)
    finally:
        component.log.removeHandler(handler)
    assert trace.result.outcome is RunOutcome.FAILED
    assert trace.result.reason == "RuntimeError: a mistake of ours"
    assert called == [True]
