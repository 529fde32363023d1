"""The flow chart of Fig. 6: its arrows, and the paper's actions, observations and marks."""

import numpy as np
from ideal_lab import I, S, lab, shape
from scripted_hardware import LENGTH_M, NODES

from dlokit.decision.config import TaskConfig
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.description.shapes import moved
from dlokit.types.flow import RunOutcome

EDGES = {
    ("find_dlo", "seen", "set_goal"),
    ("find_dlo", "unusable", "infeasible"),
    ("find_dlo", "failed", "failed"),
    ("set_goal", "done", "judge_goal"),
    ("set_goal", "failed", "failed"),
    ("judge_goal", "holds", "track_model"),
    ("judge_goal", "doubtful", "track_model"),
    ("judge_goal", "projected", "track_model"),
    ("judge_goal", "tried", "track_model"),
    ("judge_goal", "rejected", "infeasible"),
    ("judge_goal", "asked_again", "set_goal"),
    ("judge_goal", "failed", "failed"),
    ("track_model", "seen", "compare"),
    ("track_model", "unusable", "infeasible"),
    ("track_model", "failed", "failed"),
    ("compare", "converged", "converged"),
    ("compare", "not_yet", "choose_grasp"),
    ("compare", "out_of_actions", "budget_spent"),
    ("compare", "out_of_time", "budget_spent"),
    ("compare", "stalled", "stalled"),
    ("choose_grasp", "valid", "approach"),
    ("choose_grasp", "none_left", "stalled"),
    ("choose_grasp", "failed", "failed"),
    ("approach", "done", "grasp"),
    ("approach", "refused", "mark_invalid"),
    ("approach", "failed", "failed"),
    ("grasp", "held", "move_to_goal"),
    ("grasp", "missed", "release"),
    ("grasp", "refused", "release"),
    ("grasp", "failed", "failed"),
    ("grasp", "beside", "push"),
    ("push", "done", "release"),
    ("push", "refused", "release"),
    ("push", "failed", "failed"),
    ("push", "interrupted", "recover"),
    ("move_to_goal", "done", "release"),
    ("move_to_goal", "slipped", "release"),
    ("move_to_goal", "refused", "release"),
    ("move_to_goal", "failed", "failed"),
    ("release", "done", "track_again"),
    ("release", "failed", "failed"),
    ("approach", "interrupted", "recover"),
    ("grasp", "interrupted", "recover"),
    ("move_to_goal", "interrupted", "recover"),
    ("release", "interrupted", "recover"),
    ("recover", "done", "release"),
    ("recover", "carrying", "move_to_goal"),
    ("recover", "too_often", "failed"),
    ("recover", "failed", "failed"),
    ("track_again", "done", "has_error_changed"),
    ("track_again", "failed", "failed"),
    ("has_error_changed", "changed", "clear_marks"),
    ("has_error_changed", "unchanged", "mark_invalid"),
    ("clear_marks", "done", "compare"),
    ("mark_invalid", "done", "compare"),
}
"""The chart of Fig. 6, with ends that the paper does not have."""

CONTROL = {
    ("check_camera", "corrected", "find_dlo"),
    ("check_camera", "kept", "find_dlo"),
    ("check_camera", "off", "find_dlo"),
    ("check_camera", "failed", "failed"),
    ("choose_grasp", "no_gain", "stalled"),
    ("move_to_goal", "to_control", "control"),
    ("control", "corrected", "control"),
    ("control", "settled", "release"),
    ("control", "deadlock", "release"),
    ("control", "interrupted", "recover"),
    ("control", "failed", "failed"),
}
"""Additional arrows: observation of the hand, control of the grasped DLO, end of a task without expected progress."""

RESTORED = {
    ("find_dlo", "lost", "restore"),
    ("set_goal", "lost", "restore"),
    ("track_model", "lost", "restore"),
    ("track_again", "lost", "restore"),
    ("restore", "begin", "check_camera"),
    ("restore", "look_again", "track_again"),
    ("restore", "lost", "restore"),
    ("restore", "too_often", "failed"),
    ("restore", "failed", "failed"),
}
"""Arrows for components that are lost and restarted, which `test_lost_components.py` tests."""


def test_the_chart_has_these_arrows_and_no_others() -> None:
    assert set(SHAPE_DLO.edges()) == EDGES | CONTROL | RESTORED


def test_a_rope_at_its_goal_needs_no_action() -> None:
    trace = shape(lab(I), I)
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.history == ()
    assert ("compare", "converged", "converged") in trace.edges()
    assert "grasp" not in trace.calls


def test_one_action_is_grasp_carry_release_and_observation_in_the_order_of_the_paper() -> None:
    trace = shape(lab(I), moved(I, (0.05, 0.0)), TaskConfig(max_actions=1))
    boxes = [step for step, _ in trace.steps]
    first = boxes.index("choose_grasp")
    assert boxes[first : first + 9] == [
        "choose_grasp",
        "approach",
        "grasp",
        "move_to_goal",
        "release",
        "track_again",
        "has_error_changed",
        "clear_marks",
        "compare",
    ]


def test_the_loop_reaches_a_goal_that_the_rope_can_take() -> None:
    trace = shape(lab(I), moved(I, (0.08, 0.05), 0.3))
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.rmse_m < TaskConfig().threshold_m
    assert trace.result.history[-1].rmse_m == trace.result.rmse_m


def test_without_control_the_carry_ends_with_the_release_as_in_the_paper() -> None:
    trace = shape(lab(I), moved(I, (0.05, 0.0)), TaskConfig(control=False))
    assert ("move_to_goal", "done", "release") in trace.edges()
    assert "control" not in [step for step, _ in trace.steps]


def test_the_model_is_tracked_while_the_rope_is_carried_and_not_afterwards() -> None:
    calls = shape(lab(I), moved(I, (0.05, 0.0)), TaskConfig(max_actions=1)).calls
    carry = calls.index("follow_path")
    assert calls[carry - 1] == "tracking 2"
    assert calls[carry + 1] == "tracking 0"


def test_an_action_that_changes_nothing_marks_its_grasp_and_the_next_best_is_taken() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(max_actions=3))
    assert ("has_error_changed", "unchanged", "mark_invalid") in trace.edges()
    nodes = [record.grasp_node for record in trace.result.history]
    assert len(set(nodes)) == 3, "a marked node was taken again"


def test_marks_are_cleared_once_the_error_has_changed() -> None:
    # The arm refuses the best node once: it is marked. The next action changes the shape and clears the mark.
    refusing = lab(I)
    refusing.fails["move_to"] = ["unreachable"]
    trace = shape(refusing, S, TaskConfig(max_actions=2))
    assert ("approach", "refused", "mark_invalid") in trace.edges()
    assert ("has_error_changed", "changed", "clear_marks") in trace.edges()
    assert len(trace.result.history) == 2


def test_when_every_grasp_is_marked_the_task_ends_as_stalled() -> None:
    refusing = lab(I)
    refusing.fails["move_to"] = ["unreachable"] * 10 * NODES  # more than there are grasps
    trace = shape(refusing, S)
    assert ("approach", "refused", "mark_invalid") in trace.edges()
    assert ("choose_grasp", "none_left", "stalled") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert trace.result.reason


def test_a_missed_grasp_opens_the_fingers_and_counts_as_an_action() -> None:
    slippery = lab(I)
    slippery.holds = False
    trace = shape(slippery, S, TaskConfig(max_actions=2))
    assert ("grasp", "missed", "release") in trace.edges()
    assert [record.grasp_ok for record in trace.result.history] == [False, False]
    assert trace.result.outcome is RunOutcome.BUDGET


def test_a_carry_that_the_robot_refuses_is_released_where_it_is() -> None:
    refusing = lab(I)
    refusing.fails["follow_path"] = ["table_collision"]
    trace = shape(refusing, S, TaskConfig(max_actions=1))
    assert ("move_to_goal", "refused", "release") in trace.edges()


def test_fingers_that_have_no_room_to_open_beside_a_fixture_open_above_it() -> None:
    refusing = lab(I)
    refusing.fails["release"] = ["", "fixture_collision"]  # above the grasp, then at the goal
    trace = shape(refusing, S, TaskConfig(max_actions=1))
    assert ("release", "done", "track_again") in trace.edges()
    assert trace.result.history[0].grasp_ok


def test_the_ends_are_matched_to_the_goal_so_that_the_rope_is_not_reversed() -> None:
    goal = I[::-1].copy()
    trace = shape(lab(I), goal)
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.history == ()


def test_ends_confused_behind_the_arm_are_corrected_by_ordering_from_scratch() -> None:
    confused = lab(I)
    confused.confuses_ends = True
    trace = shape(confused, moved(I, (0.05, 0.0)))
    assert trace.result.outcome is RunOutcome.CONVERGED
    last = trace.result.history[-1].nodes_world
    # Half a rod's length is far more than any error of observer and model together.
    assert np.linalg.norm(last[0] - confused.nodes[0]) < 0.5 * LENGTH_M
