"""A goal is simulated in the model: it holds, may hold, or does not; and the nearest shape that holds."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as replace_belief

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape, moved
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.believed import BeliefConfig, BelievedDlo, as_configured
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import Workplace, crossings, untangling_rmse_m
from dlokit.skills.planning.verdict.goal_verdict import INFEASIBLE_FACTOR, HoldVerdict, judge
from dlokit.skills.planning.verdict.within_reach import moved_within_bounds
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Problem, Standing

THRESHOLD_M = 0.012
ROPE = BelievedDlo(belief=BeliefConfig(takes_set=0.0))
STIFF = replace(ROPE, bending_stiffness_n_m2=1e-3)
CONFIG = FeasibilityConfig()
I_SHAPE = builtin_shape("I", 0.5, 31)
S_SHAPE = builtin_shape("S", 0.5, 31)


def of(goal: Float64Array, model: BelievedDlo = ROPE, yield_curvature_1_m: float | None = None) -> GoalVerdict:
    place = Workplace(model, CONFIG, ArmKinematics(PANDA).reachable, None)
    belief = replace_belief(as_configured(model, 0), yield_curvature_1_m=yield_curvature_1_m)

    async def try_goal(nodes: Float64Array) -> HoldVerdict:
        return goal_verdict.try_goal(model, belief, nodes, THRESHOLD_M, CONFIG)

    shape = GoalShape(stamp_ns=7, nodes_world=goal)
    return asyncio.run(judge(shape, THRESHOLD_M, place=place, try_goal=try_goal))


@pytest.mark.parametrize("goal", [I_SHAPE, S_SHAPE], ids=["I", "S"])
def test_the_built_in_goals_hold_for_the_default_rope(goal: Float64Array) -> None:
    verdict = of(goal)
    assert verdict.standing is Standing.HOLDS
    assert verdict.findings == ()
    assert verdict.nearest_world is None
    assert len(verdict.releases) == 5


def test_a_goal_that_springs_back_is_infeasible_and_its_nearest_shape_holds() -> None:
    verdict = of(S_SHAPE, STIFF)
    assert verdict.standing is Standing.INFEASIBLE
    (finding,) = verdict.findings
    assert finding.problem is Problem.SPRINGS_BACK
    assert finding.amount > finding.limit == CONFIG.hold_fraction * THRESHOLD_M
    believed = verdict.releases[0]
    # The named node is the one that moved farthest, by the stated distance.
    assert believed.largest_m == pytest.approx(np.linalg.norm(believed.nodes_world - S_SHAPE, axis=1).max())
    assert f"node {believed.node}" in verdict.text
    assert verdict.nearest_world is not None
    assert verdict.nearest_rmse_m == pytest.approx(geometry.rmse_m(verdict.nearest_world, S_SHAPE))
    assert of(verdict.nearest_world, STIFF).standing is Standing.HOLDS


def test_a_goal_that_holds_only_for_some_parameters_is_doubtful() -> None:
    verdict = of(S_SHAPE, replace(ROPE, bending_stiffness_n_m2=1e-4))
    assert verdict.standing is Standing.DOUBTFUL
    at_worst, at_best = verdict.releases[1], verdict.releases[2]
    assert at_worst.rmse_m > CONFIG.hold_fraction * THRESHOLD_M
    assert at_best.rmse_m < at_worst.rmse_m


def test_a_more_uncertain_dlo_has_more_doubtful_goals() -> None:
    def known(log_sd: float, stiffness_n_m2: float) -> Standing:
        belief = BeliefConfig(stiffness_log_sd=log_sd, takes_set=0.0)
        return of(S_SHAPE, replace(ROPE, bending_stiffness_n_m2=stiffness_n_m2, belief=belief)).standing

    assert (known(0.1, 1.3e-5), known(0.1, 1e-3)) == (Standing.HOLDS, Standing.INFEASIBLE)
    assert (known(2.3, 1.3e-5), known(2.3, 1e-3)) == (Standing.DOUBTFUL, Standing.DOUBTFUL)


def test_a_stiff_wire_that_keeps_its_bends_holds_what_an_elastic_one_does_not() -> None:
    assert of(S_SHAPE, STIFF).standing is Standing.INFEASIBLE
    assert of(S_SHAPE, STIFF, yield_curvature_1_m=0.3).standing is Standing.HOLDS


def test_a_goal_that_springs_back_is_not_ruled_out_while_the_dlo_may_keep_bends() -> None:
    # By default, the DLO may keep bends; a wire that keeps its bends would hold the S.
    shipped = of(S_SHAPE, replace(STIFF, belief=BeliefConfig()))
    assert [finding.problem for finding in shipped.findings] == [Problem.SPRINGS_BACK]
    assert shipped.standing is Standing.DOUBTFUL
    almost_sure = of(S_SHAPE, replace(STIFF, belief=BeliefConfig(takes_set=goal_verdict.LARGEST_SET_PROBABILITY)))
    assert almost_sure.standing is Standing.INFEASIBLE


def test_a_goal_whose_release_ends_far_away_is_doubtful_while_a_shape_near_it_holds() -> None:
    # A released rod overshoots shapes that friction could hold: its rest shape does not exclude them.
    sure = BeliefConfig(stiffness_log_sd=0.02, weight_log_sd=0.0, friction_log_sd=0.0, takes_set=0.0)
    verdict = of(S_SHAPE, replace(ROPE, bending_stiffness_n_m2=1.3e-4, belief=sure))
    assert min(release.rmse_m for release in verdict.releases) > INFEASIBLE_FACTOR * THRESHOLD_M
    assert verdict.standing is Standing.DOUBTFUL


def test_a_goal_with_one_bend_too_tight_is_doubtful_while_a_smoother_one_is_near() -> None:
    legs_m = 0.25 * np.array([[np.cos(turn), np.sin(turn), 0.0] for turn in np.radians([25.0, -25.0])])
    middle = np.array([0.4, 0.0, 0.004])  # a node there turns by 130°: 16.7 mm / 2.27 is less than the 8 mm allowed
    verdict = of(geometry.resample(np.stack((middle + legs_m[0], middle, middle + legs_m[1])), 31))
    assert Problem.BENDS_TOO_TIGHTLY in [finding.problem for finding in verdict.findings]
    assert verdict.standing is Standing.DOUBTFUL


def test_a_goal_off_the_table_is_infeasible_and_the_nearest_shape_is_the_goal_moved_inside() -> None:
    verdict = of(moved(I_SHAPE, (0.0, 0.2)))
    assert verdict.standing is Standing.INFEASIBLE
    assert [finding.problem for finding in verdict.findings] == [Problem.OFF_TABLE]
    assert verdict.nearest_world is not None
    # The table ends at 0.38 m, the goal at 0.45 m; the move is found to a millimetre.
    assert verdict.nearest_world[-1, 1] == pytest.approx(0.38, abs=1e-3)
    assert np.ptp(verdict.nearest_world - moved(I_SHAPE, (0.0, 0.2)), axis=0) == pytest.approx(0.0, abs=1e-12)


def test_a_goal_is_not_ruled_out_while_one_bent_inside_is_within_the_threshold() -> None:
    goal = moved(I_SHAPE, (0.0, 0.15))  # its end is 20 mm off the table: no move within the threshold brings it inside
    turned = np.radians(np.interp(np.arange(30), [26, 29], [0.0, 80.0]))
    edges = np.column_stack((np.sin(turned), np.cos(turned), np.zeros(30))) * 0.5 / 30
    inside = goal[0] + np.vstack((np.zeros(3), np.cumsum(edges, axis=0)))
    assert inside[:, 1].max() < CONFIG.table_y_m[1]
    assert geometry.rmse_m(inside, goal) < THRESHOLD_M
    verdict = of(goal)
    assert [finding.problem for finding in verdict.findings] == [Problem.OFF_TABLE]
    assert verdict.standing is Standing.DOUBTFUL


def test_a_goal_across_itself_is_infeasible_and_not_simulated() -> None:
    t = np.linspace(0.0, 1.0, 200)
    loop = np.column_stack([0.5 + 0.07 * np.sin(4.2 * np.pi * t), 0.1 * (2 * t - 1) + 0.07 * np.cos(4.2 * np.pi * t)])
    verdict = of(geometry.resample(np.column_stack([loop, np.full(200, 0.004)]), 31))
    assert verdict.standing is Standing.INFEASIBLE
    assert Problem.CROSSES_ITSELF in [finding.problem for finding in verdict.findings]
    assert verdict.releases == ()
    assert verdict.nearest_world is None


def test_an_edge_that_crosses_two_others_is_not_open_already() -> None:
    # A coil of three turns: some of its edges cross two others, and no node is between those crossings.
    turn = np.linspace(0.0, 6.0 * np.pi, 200)
    coil = 0.026 * np.column_stack([np.cos(turn) + 0.12 * turn / np.pi, np.sin(turn), 0.0 * turn])
    nodes = geometry.resample(coil, 51)
    found = list(crossings(nodes[:, :2]))
    firsts = [first for first, _ in found]
    assert len(set(firsts)) < len(firsts)
    assert untangling_rmse_m(nodes, found, 0.004) > 0.001


def test_a_goal_with_only_a_crossing_tip_is_doubtful_because_an_open_shape_is_near() -> None:
    def crossed(tail_m: float) -> Float64Array:
        corners = [[0.35, 0.0], [0.55, 0.0], [0.55, 0.12], [0.45, 0.12], [0.45, -tail_m]]
        return geometry.resample(np.column_stack((corners, np.full(5, 0.004))), 121)

    little, much = (crossed(tail_m) for tail_m in (0.03, 0.10))
    pairs = [list(crossings(nodes[:, :2])) for nodes in (little, much)]
    assert [len(found) for found in pairs] == [1, 1]
    # A straight tail turned back past the strand to beside it, each half way: the integral of (x + diameter)² over it.
    for width_m in (0.0005, 0.008):
        expected_m = np.sqrt(((0.03 + width_m) ** 3 - width_m**3) / 3.0 / 2.0 / geometry.arc_lengths(little)[-1])
        found_m = untangling_rmse_m(little, pairs[0], width_m / 2.0)
        assert found_m == pytest.approx(expected_m, rel=0.25)  # nodes are 5 mm apart
    assert untangling_rmse_m(little, pairs[0], 0.004) < THRESHOLD_M < untangling_rmse_m(much, pairs[1], 0.004)
    for nodes, standing, nearness in (
        (little, Standing.DOUBTFUL, "within the threshold"),
        (much, Standing.INFEASIBLE, "more than the threshold"),
    ):
        verdict = of(geometry.resample(nodes, 31))
        (said,) = [finding.text for finding in verdict.findings if finding.problem is Problem.CROSSES_ITSELF]
        assert verdict.standing is standing
        assert nearness in said  # it states the verdict, and does not forbid a goal that is attempted


def test_a_goal_whose_strands_overlap_is_refused_or_doubtful_by_how_far_they_must_be_laid_apart() -> None:
    def beside(gap_m: float) -> Float64Array:
        """A loop (31, 3) [m] whose two straight tails are `gap_m` apart, with nodes that are not opposite."""
        turn = np.linspace(0.0, 1.5 * np.pi, 60) - 0.75 * np.pi
        loop = 0.04 * np.column_stack((np.sin(turn), 1.0 + np.cos(turn)))
        tails = np.array([[-gap_m, -0.3], [-gap_m, -0.06], [gap_m, -0.046], [gap_m, -0.286]]) / 2.0
        curve = np.concatenate((tails[:2], loop, tails[2:]))
        return geometry.resample(np.column_stack((curve[:, 0] + 0.52, curve[:, 1], np.full(len(curve), 0.004))), 31)

    length_m = float(geometry.arc_lengths(beside(0.0))[-1])
    for diameter_m, gap_m, standing in (
        (0.002, 0.001, Standing.DOUBTFUL),
        (0.008, 0.002, Standing.DOUBTFUL),
        (0.04, 0.004, Standing.INFEASIBLE),
    ):
        verdict = of(beside(gap_m), replace(ROPE, radius_m=diameter_m / 2.0, length_m=length_m))
        (lies,) = [each for each in verdict.findings if each.problem is Problem.LIES_ON_ITSELF]
        assert verdict.standing is standing
        assert lies.amount == pytest.approx(gap_m, rel=0.2)  # points are a quarter of the radius apart along a strand
        assert f"(strands {lies.amount * 1000.0:.1f} mm apart, diameter {1000.0 * diameter_m:.1f} mm)" in lies.text
        assert f"at node {lies.node} at (0.5" in lies.text
        # The tails, 0.24 m together, are laid a diameter apart, each half way; the loop's mouth adds a little.
        tails_m = (diameter_m - gap_m) / 2.0 * np.sqrt(0.24 / length_m)
        assert untangling_rmse_m(beside(gap_m), [], diameter_m / 2.0) == pytest.approx(tails_m, rel=0.3)


def test_the_same_goal_gets_the_same_verdict_to_the_bit() -> None:
    first, second = of(S_SHAPE, STIFF), of(S_SHAPE, STIFF)
    assert first.text == second.text
    assert first.nearest_world is not None
    assert second.nearest_world is not None
    assert first.nearest_world.tobytes() == second.nearest_world.tobytes()


def test_a_valid_goal_is_not_moved_and_an_unfixable_one_has_no_move() -> None:
    assert moved_within_bounds(I_SHAPE, lambda nodes: True) is I_SHAPE
    assert moved_within_bounds(I_SHAPE, lambda nodes: False) is None
