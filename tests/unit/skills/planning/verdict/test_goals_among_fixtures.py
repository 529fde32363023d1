"""Goals among fixtures: posts hold what friction does not, and nothing is laid through a fixture."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.scene import NO_FIXTURES, NO_POSTS, Box, Fixture, Post, Scene
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.believed import BeliefConfig, BelievedDlo, as_configured
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import MOST_OVERLAP_M, Workplace
from dlokit.skills.planning.verdict.goal_verdict import HoldVerdict, judge
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Problem, Release, Standing

THRESHOLD_M = 0.012
CONFIG = FeasibilityConfig()
STIFF = BelievedDlo(bending_stiffness_n_m2=3e-4, belief=BeliefConfig(takes_set=0.0))
SOFT = replace(STIFF, bending_stiffness_n_m2=1.3e-5)
REACH_M = 0.005 + STIFF.radius_m
BEND_M = 0.02
X_M = 0.52


def wrapped() -> Float64Array:
    """A U with a bend of `BEND_M` about (`X_M`, 0); its legs point to -y."""
    turn = np.linspace(0.0, np.pi, 60)
    leg_m = (STIFF.length_m - np.pi * BEND_M) / 2.0
    bend = BEND_M * np.column_stack((np.cos(turn), np.sin(turn)))
    curve = np.vstack(([BEND_M, -leg_m], bend, [-BEND_M, -leg_m])) + np.array([X_M, 0.0])
    return geometry.resample(np.column_stack((curve, np.full(len(curve), STIFF.radius_m))), STIFF.nodes)


def post(name: str, x_m: float, y_m: float = -0.03) -> Post:
    return Post(name=name, position_m=(X_M + x_m, y_m, 0.0))


OUTSIDE = (post("left", -BEND_M - REACH_M - 0.001), post("right", BEND_M + REACH_M + 0.001))
"""Posts beside the legs, a millimetre away."""


def of(model: BelievedDlo, *fixtures: Fixture, goal: Float64Array | None = None) -> GoalVerdict:
    scene = Scene(fixtures=fixtures) if fixtures else NO_FIXTURES
    place = Workplace(model, CONFIG, ArmKinematics(PANDA).reachable, None, scene=scene)
    belief = as_configured(model, 0)

    async def try_goal(nodes: Float64Array) -> HoldVerdict:
        return goal_verdict.try_goal(model, belief, nodes, THRESHOLD_M, CONFIG, scene.posts_world)

    shape = GoalShape(stamp_ns=7, nodes_world=wrapped() if goal is None else goal)
    return asyncio.run(judge(shape, THRESHOLD_M, place=place, try_goal=try_goal))


def test_a_wrap_that_posts_hold_is_said_to_hold() -> None:
    assert of(STIFF).standing is Standing.INFEASIBLE
    among = of(STIFF, *OUTSIDE)
    assert among.standing is Standing.HOLDS
    assert max(release.rmse_m for release in among.releases) < CONFIG.hold_fraction * THRESHOLD_M


def test_a_post_that_holds_nothing_leaves_the_goal_as_it_is() -> None:
    alone, beside_it = of(STIFF), of(STIFF, post("far", 0.15, 0.2))
    assert beside_it.standing is alone.standing
    assert [each.rmse_m for each in beside_it.releases] == [each.rmse_m for each in alone.releases]


def test_friction_need_not_hold_what_may_lean_on_a_post() -> None:
    belief, goal = as_configured(STIFF, 0), wrapped()
    leaning = np.abs(goal[:, 1]) < 0.05
    alone, by_posts = (goal_verdict.attainable_rmse_m(belief, goal, CONFIG, nodes) for nodes in (None, leaning))
    assert by_posts < THRESHOLD_M < alone


def test_a_goal_near_posts_on_which_it_may_lean_is_not_ruled_out() -> None:
    # The releases spring back by 14.6 mm, to the posts; by friction alone no shape is within the threshold.
    beside_m = BEND_M + REACH_M + 0.016
    near = of(STIFF, post("left", -beside_m, -0.1), post("right", beside_m, -0.1))
    assert min(release.rmse_m for release in near.releases) > goal_verdict.INFEASIBLE_FACTOR * THRESHOLD_M
    assert near.standing is Standing.DOUBTFUL


def test_no_shape_is_proposed_that_a_post_pushes_aside() -> None:
    model, wide = replace(SOFT, friction=0.3), replace(post("wide", BEND_M, -0.1), diameter_m=0.06, height_m=0.03)
    belief = as_configured(model, 0)
    alone, among = (
        goal_verdict.try_goal(model, belief, wrapped(), THRESHOLD_M, CONFIG, posts)
        for posts in (NO_POSTS, Scene(fixtures=(wide,)).posts_world)
    )
    assert alone.nearest_world is not None
    assert among.nearest_world is None


@pytest.mark.parametrize(
    ("fixtures", "proposed"),
    [
        ((), True),
        ((Box(name="block", position_m=(X_M, 0.3, 0.0)),), True),
        ((post("far", 0.0, 0.3),), False),
    ],
)
def test_a_shape_out_of_reach_is_moved_into_reach_only_where_no_post_may_hold_it(
    fixtures: tuple[Fixture, ...], proposed: bool
) -> None:
    out_of_reach = wrapped() + np.array([0.4, 0.0, 0.0])
    assert (proposal(out_of_reach, *fixtures) is not None) == proposed


def test_a_shape_in_a_fixture_is_not_proposed() -> None:
    leg = (X_M + BEND_M, -0.15, 0.0)
    assert proposal(wrapped()) is not None
    assert proposal(wrapped(), Post(name="peg", position_m=leg)) is None
    assert proposal(wrapped(), Box(name="tray", position_m=leg, size_m=(0.03, 0.03, 0.02))) is None


def proposal(nearest_world: Float64Array, *fixtures: Fixture) -> Float64Array | None:
    """What is proposed instead of a tight goal if this shape (M, 3) is the nearest one that holds."""

    async def try_goal(nodes: Float64Array) -> HoldVerdict:
        return HoldVerdict((sprung,), 0.0, nearest_world)

    sprung = Release(elastic_factor=1.0, nodes_world=wrapped(), rmse_m=0.02, node=0, largest_m=0.03)
    shape = GoalShape(stamp_ns=7, nodes_world=wrapped())
    place = Workplace(SOFT, CONFIG, ArmKinematics(PANDA).reachable, None, scene=Scene(fixtures=fixtures))
    return asyncio.run(judge(shape, THRESHOLD_M, place=place, try_goal=try_goal)).nearest_world


def test_a_proposed_shape_holds_among_the_posts_and_is_clear_of_them() -> None:
    verdict = of(replace(SOFT, friction=0.3), post("inside", 0.0, -0.05))
    assert verdict.standing is Standing.DOUBTFUL
    assert verdict.nearest_world is not None
    again = of(replace(SOFT, friction=0.3), post("inside", 0.0, -0.05), goal=verdict.nearest_world)
    assert again.standing is Standing.HOLDS


@pytest.mark.parametrize("by_m", [0.0, 0.002, 0.004, 0.009])
def test_a_goal_through_a_post_is_infeasible_but_one_that_touches_it_is_not(by_m: float) -> None:
    verdict = of(SOFT, replace(OUTSIDE[0]), post("peg", BEND_M + REACH_M - by_m))
    found = [finding for finding in verdict.findings if finding.problem is Problem.OVERLAPS_FIXTURE]
    assert len(found) == (by_m > MOST_OVERLAP_M)
    assert (verdict.standing is Standing.INFEASIBLE) == bool(found)
    for finding in found:
        assert finding.amount == pytest.approx(by_m, abs=1e-4)
        assert "post peg" in finding.text
        assert np.linalg.norm(wrapped()[finding.node, :2] - [X_M + BEND_M, -0.03]) < 0.01


def test_a_goal_over_a_box_names_the_box_and_a_near_box_is_none_of_its_business() -> None:
    tray = Box(name="tray", position_m=(X_M + BEND_M, -0.15, 0.0), size_m=(0.03, 0.03, 0.02))
    near = Box(name="block", position_m=(X_M + BEND_M + 0.06, -0.05, 0.0), size_m=(0.03, 0.03, 0.02))
    verdict = of(SOFT, tray, near)
    (finding,) = [one for one in verdict.findings if one.problem is Problem.OVERLAPS_FIXTURE]
    assert verdict.standing is Standing.INFEASIBLE
    assert "box tray" in finding.text
    # Nodes cut the bend short, which moves the leg by a third of a millimetre.
    assert finding.amount == pytest.approx(0.015 + SOFT.radius_m, abs=5e-4)
