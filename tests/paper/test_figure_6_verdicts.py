"""The goal is assessed before the robot moves: accepted, doubtful, projected, tried or rejected."""

from dataclasses import replace

import numpy as np
import pytest
from ideal_lab import ROD, I, S, lab, shape
from scripted_hardware import LENGTH_M, NODES

from dlokit.decision.config import TaskConfig
from dlokit.description.shapes import builtin_shape, moved
from dlokit.geometry import rmse_m
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.types.feasibility import Standing
from dlokit.types.flow import FlowStatus, GoalFrame, GoalFrames, RunOutcome

STIFF = replace(ROD, bending_stiffness_n_m2=1e-3, belief=replace(ROD.belief, takes_set=0.0))
"""A stiff rod that always springs back: friction holds no arc of less than 17 cm."""
DOUBTED = replace(ROD, bending_stiffness_n_m2=1e-4)
"""A rod whose S may hold or not within the uncertainty of its stiffness."""


def test_a_goal_off_the_table_is_infeasible_before_the_robot_moves() -> None:
    trace = shape(lab(I), moved(I, (0.6, 0.0)))
    assert ("judge_goal", "rejected", "infeasible") in trace.edges()
    assert trace.result.outcome is RunOutcome.INFEASIBLE
    assert trace.result.reason is not None
    assert "off_table" in trace.result.reason
    assert "grasp" not in trace.calls


def test_a_goal_that_holds_is_attempted_without_a_progress_check() -> None:
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


def test_a_projected_goal_holds_and_the_error_to_the_requested_one_is_recorded() -> None:
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


def test_a_goal_that_cannot_be_projected_is_rejected_in_spite_of_the_setting() -> None:
    loop = builtin_shape("S", LENGTH_M, NODES)
    t = np.linspace(0.0, 1.0, NODES)
    loop[:, 0], loop[:, 1] = 0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)
    trace = shape(lab(I), loop, TaskConfig(infeasible="project"))
    assert ("judge_goal", "rejected", "infeasible") in trace.edges()
    assert trace.result.reason is not None
    assert "crosses_itself" in trace.result.reason


def test_an_infeasible_goal_is_tried_on_request_and_stopped_early_without_progress() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(infeasible="try", watched_stall_actions=2), rod=STIFF)
    assert ("judge_goal", "tried", "track_model") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert len(trace.result.history) == 2


def test_a_doubtful_goal_is_tried_with_a_progress_check() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(watched_stall_actions=2), rod=DOUBTED)
    assert ("judge_goal", "doubtful", "track_model") in trace.edges()
    assert trace.result.outcome is RunOutcome.STALLED
    assert len(trace.result.history) == 2


def test_an_operator_with_an_infeasible_goal_is_asked_again() -> None:
    asked: list[str] = []

    def drags(status: FlowStatus) -> GoalFrames | None:
        if status.step != "set_goal":
            return None
        asked.append(status.text)
        x_m = 0.95 if len(asked) == 1 else 0.55  # first beyond the arm's reach
        frames = tuple(GoalFrame(node=node, x_m=x_m, y_m=y_m) for node, y_m in ((0, -0.25), (NODES - 1, 0.25)))
        return GoalFrames(stamp_ns=0, frames=frames)

    trace = shape(lab(I), None, TaskConfig(max_actions=1), operator=drags)
    assert ("judge_goal", "asked_again", "set_goal") in trace.edges()
    assert ("judge_goal", "holds", "track_model") in trace.edges()
    assert "off_table" in asked[1]
    assert "press Shape it again" in asked[1]


def test_a_failed_assessment_of_the_goal_fails_the_task(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise ValueError("a goal that nothing can be laid in")

    monkeypatch.setattr(goal_verdict, "settle", fails)
    trace = shape(lab(I), S)
    assert ("judge_goal", "failed", "failed") in trace.edges()
