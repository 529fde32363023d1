"""The flow chart of Fig. 6, edge by edge, and the ends that the paper lacks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ideal_lab import LENGTH_M, NODES, ROD, Lab, shape

from dlokit.decision.config import TaskConfig
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.description.shapes import builtin_shape, moved
from dlokit.geometry import rmse_m
from dlokit.skills.model.config import SettleConfig
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.rollouts.search import SearchConfig
from dlokit.skills.planning.rollouts.strategy import RolloutConfig
from dlokit.types.feasibility import Standing
from dlokit.types.flow import Command, FlowStatus, GoalFrame, GoalFrames, Mode, RunOutcome

I = builtin_shape("I", LENGTH_M, NODES)  # noqa: E741  the shape is called so
S = builtin_shape("S", LENGTH_M, NODES)

STIFF = replace(ROD, bending_stiffness_n_m2=1e-3, belief=replace(ROD.belief, takes_set=0.0))
"""A stiff rod that always springs back: friction holds no arc of less than 17 cm."""
DOUBTED = replace(ROD, bending_stiffness_n_m2=1e-4)
"""A rod whose S may hold or not, as far as its stiffness is known."""

EDGES = {
    ("find_dlo", "seen", "set_goal"),
    ("find_dlo", "unusable", "infeasible"),
    ("find_dlo", "failed", "failed"),
    ("set_goal", "set", "judge_goal"),
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
    ("recover", "too_often", "failed"),
    ("recover", "failed", "failed"),
    ("track_again", "seen", "has_error_changed"),
    ("track_again", "unusable", "infeasible"),
    ("track_again", "failed", "failed"),
    ("has_error_changed", "changed", "clear_marks"),
    ("has_error_changed", "unchanged", "mark_invalid"),
    ("clear_marks", "done", "compare"),
    ("mark_invalid", "done", "compare"),
}
"""The chart of Fig. 6, with the ends that the paper lacks."""

CONTROL = {
    ("choose_grasp", "no_gain", "stalled"),
    ("move_to_goal", "to_control", "control"),
    ("control", "corrected", "control"),
    ("control", "settled", "release"),
    ("control", "deadlock", "release"),
    ("control", "interrupted", "recover"),
    ("control", "failed", "failed"),
}
"""What is there besides: control while the DLO is held, and the end of a task without hope."""


PUSHES = PlanningConfig(
    strategy=RolloutConfig(
        search=SearchConfig(rollouts=40, finalists=2, generations=1),
        pick_place=False,
        drag=False,
        lay_down=False,
        push=True,
    )
)
"""A planner that can do nothing but push."""


def lab(nodes: np.ndarray = I) -> Lab:
    return Lab(nodes=nodes.copy())


def test_the_chart_has_these_arrows_and_no_others() -> None:
    assert set(SHAPE_DLO.edges()) == EDGES | CONTROL


def test_without_control_the_carry_ends_with_the_release_as_in_the_paper() -> None:
    trace = shape(lab(I), moved(I, (0.05, 0.0)), TaskConfig(control=False))
    assert ("move_to_goal", "done", "release") in trace.edges()
    assert "control" not in [step for step, _ in trace.steps]


def test_a_rope_at_its_goal_needs_no_action() -> None:
    trace = shape(lab(I), I)
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.history == ()
    assert ("compare", "converged", "converged") in trace.edges()
    assert "grasp" not in trace.calls


def test_one_action_is_grasp_carry_release_and_look_in_the_order_of_the_paper() -> None:
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


def test_the_loop_reaches_a_goal_that_obeys_the_rope() -> None:
    trace = shape(lab(I), moved(I, (0.08, 0.05), 0.3))
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.rmse_m < TaskConfig().threshold_m
    assert trace.result.history[-1].rmse_m == trace.result.rmse_m


def test_the_model_is_tracked_while_the_rope_is_carried_and_not_afterwards() -> None:
    calls = shape(lab(I), moved(I, (0.05, 0.0)), TaskConfig(max_actions=1, tracking_hz=3.0)).calls
    carry = calls.index("follow_path")
    assert calls[carry - 1] == "tracking 3"
    assert calls[carry + 1] == "tracking 0"


def test_an_action_that_changes_nothing_marks_its_grasp_and_the_next_best_is_taken() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(max_actions=3))
    assert ("has_error_changed", "unchanged", "mark_invalid") in trace.edges()
    nodes = [record.grasp_node for record in trace.result.history]
    assert len(set(nodes)) == 3, "a marked node was taken again"


def test_a_rope_that_slips_out_on_the_way_is_let_go_and_looked_for_again() -> None:
    slippery = lab(I)
    slippery.feels = True
    slippery.slips = 1
    trace = shape(slippery, S, TaskConfig(max_actions=2))
    assert ("move_to_goal", "slipped", "release") in trace.edges()
    assert [record.slipped for record in trace.result.history] == [True, False]
    assert trace.result.history[0].grasp_ok
    carry = trace.calls.index("follow_path")
    assert trace.calls[carry + 1 : carry + 4] == ["stop", "tracking 0", "release"]


def test_a_node_at_which_the_rope_slipped_twice_is_not_grasped_again() -> None:
    slippery = lab(I)
    slippery.feels = True
    slippery.slips = 20
    # Whatever changes the error clears the marks of Fig. 6: only what slipped is left out here.
    trace = shape(slippery, S, TaskConfig(max_actions=7, changed_m=0.0))
    nodes = [record.grasp_node for record in trace.result.history]
    assert all(record.slipped for record in trace.result.history)
    assert max(nodes.count(node) for node in nodes) <= 2


def test_a_rope_that_lies_where_it_was_though_it_seemed_held_has_slipped() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(max_actions=1))
    (record,) = trace.result.history
    assert record.grasp_ok
    assert record.slipped


@pytest.mark.parametrize("learn", [True, False])
def test_the_dlo_is_learnt_from_an_action_where_that_is_asked_for(learn: bool) -> None:
    feeling = lab(I)
    feeling.feels = True
    trace = shape(feeling, S, TaskConfig(max_actions=1, learn=learn))
    assert trace.belief is not None
    assert trace.belief.actions == (1 if learn else 0)


def test_marks_are_cleared_once_the_error_has_changed() -> None:
    # The arm refuses the best node once: it is marked. The next action changes the shape and clears the mark.
    refusing = lab(I)
    refusing.fails["move_to"] = ["unreachable"]
    trace = shape(refusing, S, TaskConfig(max_actions=2))
    assert ("approach", "refused", "mark_invalid") in trace.edges()
    assert ("has_error_changed", "changed", "clear_marks") in trace.edges()
    assert len(trace.result.history) == 2


def test_when_every_grasp_is_marked_the_task_ends_as_stalled() -> None:
    trace = shape(lab(I), S, reachable=lambda pose: abs(pose.position_m[1]) < 0.3 and pose.position_m[2] > 1.0)
    assert trace.result.outcome in (RunOutcome.STALLED, RunOutcome.INFEASIBLE)
    assert trace.result.reason


def test_a_missed_grasp_opens_the_fingers_counts_as_an_action_and_goes_on() -> None:
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


SERVO = TaskConfig(control=True, max_actions=1, threshold_m=0.004)


def feeling_lab() -> Lab:
    felt = lab(I)
    felt.feels = True  # control goes on only while something is felt between the fingers
    return felt


def test_control_corrects_while_the_rope_is_held_and_then_lets_go() -> None:
    trace = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO)
    assert ("move_to_goal", "to_control", "control") in trace.edges()
    assert ("control", "corrected", "control") in trace.edges()
    assert ("control", "settled", "release") in trace.edges()
    [record] = trace.result.history
    assert record.corrections
    first = record.corrections[0]
    assert first.predicted_m < first.before_m
    assert first.seen_m is not None


def test_whoever_watches_is_told_whether_it_plans_or_controls() -> None:
    told: dict[str, Mode | None] = {}

    def watch(status: FlowStatus) -> None:
        told[status.step] = status.mode

    shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO, operator=watch)
    assert told["choose_grasp"] is told["move_to_goal"] is Mode.PLANNING
    assert told["control"] is Mode.CONTROL
    assert told["track_again"] is None


def test_corrections_of_one_grasp_are_bounded() -> None:
    trace = shape(feeling_lab(), moved(I, (0.04, 0.03)), replace(SERVO, max_corrections=1))
    [record] = trace.result.history
    assert len(record.corrections) == 1
    assert record.control_end in ("corrections_spent", "no_gain", "good_enough")


def test_a_correction_that_the_robot_refuses_is_a_deadlock_and_marks_the_grasp() -> None:
    refusing = feeling_lab()
    refusing.fails["move_linear"] = ["", "unreachable"]  # down to the grasp, then the first correction
    trace = shape(refusing, moved(I, (0.04, 0.03)), replace(SERVO, max_actions=2, threshold_m=0.001, infeasible="try"))
    assert ("control", "deadlock", "release") in trace.edges()
    first, second = trace.result.history
    assert first.control_end == "out_of_reach"
    assert first.grasp_node != second.grasp_node


def test_an_arm_that_brakes_in_a_correction_is_cleared_and_lets_go() -> None:
    late = feeling_lab()
    late.fails["move_linear"] = ["", "lost_commander"]
    trace = shape(late, moved(I, (0.04, 0.03)), SERVO)
    assert ("control", "interrupted", "recover") in trace.edges()
    assert ("recover", "done", "release") in trace.edges()


def test_an_arm_lost_in_a_correction_fails_the_task() -> None:
    broken = feeling_lab()
    broken.fails["move_linear"] = ["", "robot_lost"]
    assert ("control", "failed", "failed") in shape(broken, moved(I, (0.04, 0.03)), SERVO).edges()


def test_a_rope_that_is_not_seen_while_held_is_let_go_uncorrected() -> None:
    blind = feeling_lab()
    looks_before = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO).calls
    before = looks_before[: looks_before.index("follow_path")].count("look")
    blind.fails["look"] = [""] * before + ["no_points"]
    trace = shape(blind, moved(I, (0.04, 0.03)), SERVO)
    assert ("control", "settled", "release") in trace.edges()
    [record] = trace.result.history
    assert record.control_end == "not_seen"
    assert record.corrections == ()


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
    if trace.result.outcome is RunOutcome.FAILED:
        assert trace.calls[-2:] == ["stop", "tracking 0"]


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


def test_an_arm_that_brakes_again_and_again_fails_the_task_by_name() -> None:
    late = lab(I)
    late.fails["move_to"] = ["lost_commander"] * 3
    trace = shape(late, S, TaskConfig(max_recoveries=2))
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


def test_a_goal_off_the_table_is_infeasible_before_the_robot_moves() -> None:
    trace = shape(lab(I), moved(I, (0.6, 0.0)))
    assert ("judge_goal", "rejected", "infeasible") in trace.edges()
    assert trace.result.outcome is RunOutcome.INFEASIBLE
    assert trace.result.reason is not None
    assert "off_table" in trace.result.reason
    assert "grasp" not in trace.calls


def test_a_goal_that_holds_is_shaped_to_and_not_watched() -> None:
    trace = shape(lab(I), S, TaskConfig(max_actions=1))
    assert ("judge_goal", "holds", "track_model") in trace.edges()
    assert trace.result.verdict is not None
    assert trace.result.verdict.standing is Standing.HOLDS


def test_a_goal_that_springs_back_is_rejected_with_the_nearest_shape_that_holds() -> None:
    trace = shape(lab(I), S, rod=STIFF)
    assert ("judge_goal", "rejected", "infeasible") in trace.edges()
    assert trace.result.outcome is RunOutcome.INFEASIBLE
    assert trace.result.reason is not None
    assert "springs_back" in trace.result.reason
    verdict = trace.result.verdict
    assert verdict is not None
    assert verdict.nearest_world is not None
    assert "grasp" not in trace.calls


def test_a_projected_goal_is_one_that_holds_and_the_error_to_the_one_asked_for_is_kept() -> None:
    trace = shape(lab(I), S, TaskConfig(max_actions=1, infeasible="project"), rod=STIFF)
    assert ("judge_goal", "projected", "track_model") in trace.edges()
    result = trace.result
    assert result.verdict is not None
    assert result.goal is not None
    assert result.asked is not None
    # The model resamples a goal, which cuts its corners by less than a tenth of a millimetre.
    assert result.verdict.nearest_world is not None
    assert np.allclose(result.goal.nodes_world, result.verdict.nearest_world, atol=1e-4)
    assert np.allclose(result.asked.nodes_world, S, atol=1e-4)
    assert result.asked_rmse_m is not None
    # The lab's camera sees its rope to less than a millimetre.
    assert result.asked_rmse_m == pytest.approx(rmse_m(result.history[-1].nodes_world, S), abs=1e-3)
    again = shape(lab(I), result.goal.nodes_world, TaskConfig(max_actions=1), rod=STIFF)
    assert ("judge_goal", "holds", "track_model") in again.edges()


def test_a_goal_that_cannot_be_projected_is_rejected_though_projecting_was_asked_for() -> None:
    loop = builtin_shape("S", LENGTH_M, NODES)
    t = np.linspace(0.0, 1.0, NODES)
    loop[:, 0], loop[:, 1] = 0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)
    trace = shape(lab(I), loop, TaskConfig(infeasible="project"))
    assert ("judge_goal", "rejected", "infeasible") in trace.edges()
    assert trace.result.reason is not None
    assert "crosses_itself" in trace.result.reason


def test_an_infeasible_goal_is_tried_when_asked_and_stopped_soon_without_progress() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(infeasible="try", watched_stall_actions=2), rod=STIFF)
    assert ("judge_goal", "tried", "track_model") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert len(trace.result.history) == 2


def test_a_doubtful_goal_is_tried_and_watched() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(watched_stall_actions=2), rod=DOUBTED)
    assert ("judge_goal", "doubtful", "track_model") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert len(trace.result.history) == 2


def test_an_operator_whose_goal_cannot_be_is_asked_again() -> None:
    asked: list[str] = []

    def drags(status: FlowStatus) -> GoalFrames | None:
        if status.step != "set_goal":
            return None
        asked.append(status.text)
        x_m = 0.95 if len(asked) == 1 else 0.55  # first beyond the arm's reach
        frames = tuple(GoalFrame(node=node, x_m=x_m, y_m=y_m) for node, y_m in ((0, -0.25), (30, 0.25)))
        return GoalFrames(stamp_ns=0, frames=frames)

    trace = shape(lab(I), None, TaskConfig(max_actions=1), operator=drags)
    assert ("judge_goal", "asked_again", "set_goal") in trace.edges()
    assert ("judge_goal", "holds", "track_model") in trace.edges()
    assert "off_table" in asked[1]
    assert "press Shape it again" in asked[1]


def test_a_judge_that_fails_fails_the_task() -> None:
    trace = shape(lab(I), S, rod=replace(ROD, settle=SettleConfig(timestep_s=math.nan)))
    assert ("judge_goal", "failed", "failed") in trace.edges()


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
    # A goal so near that no action of the model's rod brings it nearer by `progress_m`.
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
    assert trace.calls[-2:] == ["stop", "tracking 0"]


def test_the_ends_are_labelled_towards_the_goal_so_that_the_rope_is_not_turned_round() -> None:
    goal = I[::-1].copy()
    trace = shape(lab(I), goal)
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert trace.result.history == ()


def test_ends_confused_behind_the_arm_are_put_right_by_looking_anew() -> None:
    confused = lab(I)
    confused.confuses_ends = True
    trace = shape(confused, moved(I, (0.05, 0.0)))
    assert trace.result.outcome is RunOutcome.CONVERGED
    last = trace.result.history[-1].nodes_world
    # Half a rod's length is far more than any error of observer and model together.
    assert np.linalg.norm(last[0] - confused.nodes[0]) < 0.5 * LENGTH_M


def test_a_push_comes_down_closed_holds_nothing_and_is_seen_afterwards() -> None:
    trace = shape(lab(I), moved(I, (0.03, 0.0)), TaskConfig(max_actions=1), planning=PUSHES)
    assert {("grasp", "beside", "push"), ("push", "done", "release")} <= trace.edges()
    assert "grasp" not in trace.calls
    (record,) = trace.result.history
    assert (record.kind, record.grasp_ok, record.slipped) == ("push", False, False)
    assert record.rmse_m < 0.03


@pytest.mark.parametrize(
    ("reason", "edge"),
    [
        ("unreachable", ("push", "refused", "release")),
        ("lost_commander", ("push", "interrupted", "recover")),
        ("fault", ("push", "failed", "failed")),
    ],
)
def test_a_push_that_the_arm_does_not_do_ends_by_name(reason: str, edge: tuple[str, str, str]) -> None:
    broken = lab(I)
    broken.fails = {"follow_path": [reason]}
    assert edge in shape(broken, moved(I, (0.03, 0.0)), TaskConfig(max_actions=1), planning=PUSHES).edges()
