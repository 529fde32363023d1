"""Ends and continuations that the paper does not have: failures, an arm that braked, budgets, the operator."""

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
        ("look", "no_points", ("find_dlo", "unusable", "infeasible")),
        ("look", "too_much_segmented", ("find_dlo", "unusable", "infeasible")),
        ("home", "robot_lost", ("find_dlo", "failed", "failed")),
        ("move_to", "robot_lost", ("approach", "failed", "failed")),
        ("move_linear", "robot_lost", ("grasp", "failed", "failed")),
        ("grasp", "robot_lost", ("grasp", "failed", "failed")),
        ("follow_path", "robot_lost", ("move_to_goal", "failed", "failed")),
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
    if trace.result.outcome is RunOutcome.FAILED:
        assert trace.calls[-2:] == ["halt", "tracking 0"]


@pytest.mark.parametrize(
    ("skill", "reason", "box"),
    [
        ("follow_path", "stopped", "move_to_goal"),
        ("move_to", "stop_latched", "approach"),
        ("home", "stopped", "find_dlo"),
    ],
)
def test_a_person_who_stops_an_arm_has_cancelled_the_task_and_nothing_has_failed(
    skill: str, reason: str, box: str
) -> None:
    stopped = lab(I)
    stopped.fails[skill] = [reason]
    trace = shape(stopped, S)
    assert (box, "failed", "failed") in trace.edges()
    assert trace.result.outcome is RunOutcome.CANCELLED
    assert trace.result.reason is not None
    assert reason.replace("_", " ") in trace.result.reason.replace("_", " ")
    assert "by the script" in trace.result.reason
    assert trace.result.reason.endswith(f"in the step “{box.replace('_', ' ')}”")
    assert "robot." not in trace.result.reason
    assert trace.calls[-2:] == ["halt", "tracking 0"]


@pytest.mark.parametrize(
    ("skill", "box"),
    [("move_to", "approach"), ("move_linear", "grasp"), ("follow_path", "move_to_goal"), ("release", "approach")],
)
def test_an_arm_that_braked_on_its_own_is_recovered_releases_and_the_task_continues(skill: str, box: str) -> None:
    late = lab(I)
    late.fails[skill] = ["lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert (box, "interrupted", "recover") in trace.edges()
    assert ("recover", "done", "release") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


@pytest.mark.parametrize("reached", [0, 1, 2])
def test_a_carry_goes_on_from_where_it_was_interrupted_while_the_rope_is_felt(reached: int) -> None:
    late = lab(I)
    late.feels, late.brakes_after = True, reached
    late.fails["follow_path"] = ["lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert ("recover", "carrying", "move_to_goal") in trace.edges()
    carry = trace.calls.index("follow_path")
    assert "release" not in trace.calls[carry : trace.calls.index("follow_path", carry + 1)]
    whole, rest = ([pose.position_m.tolist() for pose in path] for path in late.paths[:2])
    assert rest == whole[max(reached - 1, 0) :]  # a corner is the end of its line, too
    assert trace.result.history[0].ended_by is None
    assert [(one.action, one.reason) for one in trace.result.recoveries] == [(1, "lost_commander")]
    assert trace.result.outcome is RunOutcome.CONVERGED


@pytest.mark.parametrize("reason", ["reflex", "tracking"])
def test_a_rope_is_released_where_the_arm_may_have_touched_something(reason: str) -> None:
    late = lab(I)
    late.feels = True
    late.fails["follow_path"] = [reason]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert ("recover", "carrying", "move_to_goal") not in trace.edges()
    assert trace.result.history[0].ended_by == reason


def test_a_release_after_a_reflex_that_is_interrupted_does_not_carry_on() -> None:
    late = lab(I)
    late.feels = True
    late.fails = {"follow_path": ["reflex"], "release": ["", "lease_lost"]}  # it opens above the grasp first
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert [one.reason for one in trace.result.recoveries] == ["reflex", "lease_lost"]
    assert ("recover", "carrying", "move_to_goal") not in trace.edges()


def test_a_rope_that_was_lost_while_the_carry_was_interrupted_is_released_and_observed() -> None:
    late = lab(I)
    late.feels, late.loses_at_brake = True, True
    late.fails["follow_path"] = ["lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert ("recover", "done", "release") in trace.edges()
    assert trace.result.history[0].ended_by


def test_an_action_interrupted_before_its_grasp_does_not_count_as_held() -> None:
    late = lab(I)
    late.fails["move_to"] = ["", "lost_commander"]  # the first action is complete, the second is interrupted
    trace = shape(late, S, TaskConfig(max_actions=2))
    assert [record.grasp_ok for record in trace.result.history] == [True, False]


def test_an_arm_that_braked_before_the_first_observation_is_moved_out_of_view_again() -> None:
    late = lab(I)
    late.fails["home"] = ["lease_lost", "lost_commander"]
    trace = shape(late, moved(I, (0.05, 0.0)))
    assert trace.calls.count("recover") == 2
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_an_arm_that_never_reaches_home_fails_the_task_by_name() -> None:
    late = lab(I)
    late.fails["home"] = ["lease_lost"] * (MOST_RECOVERIES + 1)
    trace = shape(late, S)
    assert trace.result.outcome is RunOutcome.FAILED
    assert trace.result.reason is not None
    assert "lease_lost" in trace.result.reason


def test_an_arm_that_brakes_repeatedly_fails_the_task_by_name() -> None:
    late = lab(I)
    late.fails["move_to"] = ["lost_commander"] * (MOST_RECOVERIES + 1)
    trace = shape(late, S)
    assert ("recover", "too_often", "failed") in trace.edges()
    assert trace.result.reason is not None
    assert "lost_commander" in trace.result.reason


@pytest.mark.parametrize("reason", ["reflex", "tracking"])
def test_a_reflex_is_recovered_once_an_action_and_counted_in_the_result(reason: str) -> None:
    late = lab(I)
    late.fails["follow_path"] = [reason, reason]
    result = shape(late, S, TaskConfig(max_actions=2)).result
    assert [(one.action, one.reason) for one in result.recoveries] == [(1, reason), (2, reason)]
    assert result.outcome is not RunOutcome.FAILED


@pytest.mark.parametrize("second", ["reflex", "tracking"])
def test_a_second_reflex_in_one_action_is_left_to_a_person(second: str) -> None:
    late = lab(I)
    late.fails = {"follow_path": ["reflex"], "release": ["", second]}
    trace = shape(late, S)
    assert ("recover", "too_often", "failed") in trace.edges()
    assert trace.calls.count("recover") == 1
    assert [one.reason for one in trace.result.recoveries] == ["reflex"]
    assert trace.result.reason is not None
    assert "needs a person" in trace.result.reason
    assert second in trace.result.reason


def test_a_second_reflex_before_the_first_observation_ends_the_task_by_name() -> None:
    late = lab(I)
    late.fails["home"] = ["reflex", "reflex"]
    trace = shape(late, S)
    assert (trace.result.outcome, trace.calls.count("recover")) == (RunOutcome.FAILED, 1)
    assert trace.result.reason is not None
    assert "reflex" in trace.result.reason


def test_late_heartbeats_are_recovered_several_times_an_action() -> None:
    late = lab(I)
    late.fails = {"follow_path": ["lost_commander"], "release": ["", "lease_lost"]}
    result = shape(late, moved(I, (0.05, 0.0))).result
    assert [one.reason for one in result.recoveries] == ["lost_commander", "lease_lost"]
    assert result.outcome is RunOutcome.CONVERGED


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


@pytest.mark.parametrize("reason", ["camera_lost", "clock_jumped"])
@pytest.mark.parametrize(("seen_before", "box"), [(0, "find_dlo"), (1, "track_model"), (3, "track_again")])
def test_a_camera_that_returns_is_awaited_and_nothing_moves_on_its_bad_pictures(
    reason: str, seen_before: int, box: str
) -> None:
    broken = lab(I)
    broken.fails["look"] = [""] * seen_before + [reason]
    trace = shape(broken, moved(I, (0.05, 0.0)))
    assert (box, "lost", "restore") in trace.edges()
    assert trace.result.outcome is RunOutcome.CONVERGED


@pytest.mark.parametrize("reason", ["camera_lost", "clock_jumped"])
def test_a_camera_that_does_not_return_fails_the_task_by_name(reason: str) -> None:
    broken = lab(I)
    seen_before = 3  # one to find the rope and two to see that it rests
    broken.fails["look"] = [""] * seen_before + [reason] * 50
    trace = shape(broken, S)
    assert ("track_again", "lost", "restore") in trace.edges()
    assert ("restore", "too_often", "failed") in trace.edges()
    assert trace.result.reason is not None
    assert reason in trace.result.reason
    assert len([call for call in trace.calls if call == "follow_path"]) == 1


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


def test_a_threshold_set_too_low_stalls_instead_of_refining_without_end() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(stall_actions=2, threshold_m=1e-4, infeasible="try"))
    assert ("compare", "stalled", "stalled") in trace.edges()


def test_a_task_ends_when_no_gain_is_predicted_after_actions_without_progress() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    # A goal so near that no action of the model's rod reduces the error by `PROGRESS_M`.
    trace = shape(
        stubborn, moved(I, (0.002, 0.0)), TaskConfig(no_progress_actions=2, threshold_m=5e-4, infeasible="try")
    )
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


@pytest.mark.parametrize(("step", "counted"), [("judge_goal", 0), ("grasp", 1), ("release", 1)])
def test_a_task_that_is_stopped_counts_the_action_under_way(step: str, counted: int) -> None:
    ends: list[int] = []

    def presses_stop(status: FlowStatus) -> Command | None:
        if status.outcome is not None:
            ends.append(status.actions)
        return Command.STOP if status.step == step else None

    trace = shape(lab(I), S, operator=presses_stop)
    assert trace.result.outcome is RunOutcome.CANCELLED
    assert (trace.result.history, trace.result.unfinished) == ((), bool(counted))
    assert ends == [counted]


def test_an_action_that_was_refused_or_has_ended_is_not_counted_as_unfinished() -> None:
    refuses = lab(I)
    refuses.fails["move_to"] = ["unreachable"] * 100
    trace = shape(refuses, S)
    assert ("approach", "refused", "mark_invalid") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert (trace.result.history, trace.result.unfinished) == ((), False)
    assert not shape(lab(I), moved(I, (0.05, 0.0))).result.unfinished


def test_waiting_for_the_operator_does_not_count_as_computing() -> None:
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
