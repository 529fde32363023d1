"""A goal is settled in the model: what holds, what may, what does not, and the nearest shape that does."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.shapes import builtin_shape, moved
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.planning import holding
from dlokit.skills.planning.actions import FeasibilityConfig, GraspConfig
from dlokit.skills.planning.feasibility import Workplace
from dlokit.skills.planning.goal_verdict import judge
from dlokit.skills.planning.holding import Hold, aligned
from dlokit.skills.planning.inside import moved_inside
from dlokit.skills.robot.kinematics import PandaKinematics
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Problem, Standing

THRESHOLD_M = 0.012
ROPE = ModelConfig()
STIFF = replace(ROPE, bending_stiffness_n_m2=1e-3)
CONFIG = FeasibilityConfig()
I_SHAPE = builtin_shape("I", 0.5, 31)
S_SHAPE = builtin_shape("S", 0.5, 31)


def of(goal: Float64Array, model: ModelConfig = ROPE) -> GoalVerdict:
    place = Workplace(CONFIG, GraspConfig(), PandaKinematics().reachable, None)

    async def try_goal(nodes: Float64Array) -> Hold:
        return holding.try_goal(model, nodes, THRESHOLD_M, CONFIG)

    shape = GoalShape(stamp_ns=7, nodes_world=goal)
    return asyncio.run(judge(shape, THRESHOLD_M, place=place, length_m=0.5, radius_m=0.004, try_goal=try_goal))


@pytest.mark.parametrize("goal", [I_SHAPE, S_SHAPE], ids=["I", "S"])
def test_the_built_in_goals_hold_for_the_default_rope(goal: Float64Array) -> None:
    verdict = of(goal)
    assert verdict.standing is Standing.HOLDS
    assert verdict.findings == ()
    assert verdict.nearest_world is None
    assert len(verdict.releases) == 3


def test_a_goal_that_springs_back_is_infeasible_and_the_nearest_shape_holds_when_it_is_judged_itself() -> None:
    verdict = of(S_SHAPE, STIFF)
    assert verdict.standing is Standing.INFEASIBLE
    (finding,) = verdict.findings
    assert finding.problem is Problem.SPRINGS_BACK
    assert finding.amount > finding.limit == CONFIG.hold_share * THRESHOLD_M
    believed = verdict.releases[0]
    # The node that is named is the one that moved farthest, by as much as is said.
    assert believed.largest_m == pytest.approx(np.linalg.norm(believed.nodes_world - S_SHAPE, axis=1).max())
    assert f"node {believed.node}" in verdict.text
    assert verdict.nearest_world is not None
    assert verdict.nearest_rmse_m == pytest.approx(geometry.rmse_m(verdict.nearest_world, S_SHAPE))
    assert of(verdict.nearest_world, STIFF).standing is Standing.HOLDS


def test_a_goal_that_holds_only_as_far_as_the_model_is_right_is_doubtful() -> None:
    verdict = of(S_SHAPE, replace(ROPE, bending_stiffness_n_m2=1e-4))
    assert verdict.standing is Standing.DOUBTFUL
    at_worst, at_best = verdict.releases[1], verdict.releases[2]
    assert at_worst.rmse_m > CONFIG.hold_share * THRESHOLD_M
    assert at_best.rmse_m < at_worst.rmse_m


def test_a_goal_off_the_table_is_infeasible_and_the_nearest_one_is_the_same_moved_inside() -> None:
    verdict = of(moved(I_SHAPE, (0.0, 0.2)))
    assert verdict.standing is Standing.INFEASIBLE
    assert [finding.problem for finding in verdict.findings] == [Problem.OFF_TABLE]
    assert verdict.nearest_world is not None
    # The table ends at 0.38 m, the goal at 0.45 m; the move is found to a millimetre.
    assert verdict.nearest_world[-1, 1] == pytest.approx(0.38, abs=1e-3)
    assert np.ptp(verdict.nearest_world - moved(I_SHAPE, (0.0, 0.2)), axis=0) == pytest.approx(0.0, abs=1e-12)


def test_a_goal_off_the_table_by_less_than_the_threshold_is_doubtful() -> None:
    assert of(moved(I_SHAPE, (0.0, 0.136))).standing is Standing.DOUBTFUL


def test_a_goal_across_itself_is_infeasible_and_not_even_tried() -> None:
    t = np.linspace(0.0, 1.0, 200)
    loop = np.column_stack([0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)])
    verdict = of(geometry.resample(np.column_stack([loop, np.full(200, 0.004)]), 31))
    assert verdict.standing is Standing.INFEASIBLE
    assert Problem.CROSSES_ITSELF in [finding.problem for finding in verdict.findings]
    assert verdict.releases == ()
    assert "No shape near it was found that holds" in verdict.text


def test_the_same_goal_gets_the_same_verdict_to_the_bit() -> None:
    first, second = of(S_SHAPE, STIFF), of(S_SHAPE, STIFF)
    assert first.text == second.text
    assert first.nearest_world is not None
    assert second.nearest_world is not None
    assert first.nearest_world.tobytes() == second.nearest_world.tobytes()


def test_alignment_moves_and_turns_but_does_not_bend() -> None:
    back = aligned(moved(S_SHAPE, (0.05, -0.02), 0.7), S_SHAPE)
    assert back == pytest.approx(S_SHAPE, abs=1e-9)


def test_no_move_is_better_than_one_and_what_cannot_be_mended_has_none() -> None:
    assert moved_inside(I_SHAPE, lambda nodes: True) is I_SHAPE
    assert moved_inside(I_SHAPE, lambda nodes: False) is None
