"""The verdict on a goal: holds, doubtful or infeasible, why, and the nearest shape that holds.

Whether friction holds it is predicted by releases of the rod, whose parameters are uncertain: from the stiffest on the
smoothest table to the softest on the roughest. The budget is counted in releases, not in seconds.
"""

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.scene import NO_POSTS
from dlokit.rod.believed import BelievedDlo, fit_length
from dlokit.rod.equilibrium import nearest_static
from dlokit.rod.rollout import PlanningRod, settle
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict.feasibility import (
    Workplace,
    bends,
    crossings,
    crowded,
    is_within_bounds,
    length_finding,
    misfits,
    out_of_bounds,
    overlaps,
    overlaps_fixtures,
    place_of,
    untangling_rmse_m,
)
from dlokit.skills.planning.verdict.within_reach import moved_within_bounds, unreachable_rmse_m
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloBelief, GoalShape
from dlokit.types.feasibility import Finding, GoalVerdict, Problem, Release, Standing

LARGEST_SET_PROBABILITY = 0.05
"""A goal can be infeasible because of spring-back only if the probability of a plastic DLO is at most this."""
_UNCERTAIN_SDS = 2.0  # standard deviations of EI / (μ w) that the releases cover on either side
_YIELD_UNCERTAINTY = 1.5  # uncertainty of the yield curvature, as a factor
_NEAREST_FRACTIONS = (0.75, 0.5, 0.35)
"""Fractions of friction for the search of the nearest shape, tried until one holds in all releases."""
_LEANS_M = 0.02
"""A node whose surface is nearer than this to a post may lean on it in a shape near the goal [m]."""
_SPREAD = (0.0, 1.0, -1.0, 0.5, -0.5)  # of the uncertainty: assumed, stiffest, softest, between


@dataclass(frozen=True)
class HoldVerdict:
    """Result of the simulated releases of a goal."""

    releases: tuple[Release, ...]
    """With the assumed parameters, the stiffest, the softest, and between."""
    attainable_rmse_m: float
    """RMSE of the nearest shape that holds with the softest rod on the roughest table [m]."""
    nearest_world: Float64Array | None  # (M, 3) [m]
    """The nearest shape found that holds for all assumed parameters, anywhere on the table: the goal itself, at
    the rod's length, where that does. None: none was found."""


@dataclass(frozen=True, kw_only=True)
class Plausible:
    """One of the rods with which a goal is tested."""

    elastic_factor: float
    """Ratio of its EI / (μ w) to the model's."""
    yield_curvature_1_m: float
    """Yield curvature [1/m]; infinite: elastic."""

    @property
    def planning_rod(self) -> PlanningRod:
        """The planning rod with this EI / (μ w): the factor is split between stiffness and friction."""
        fraction = math.sqrt(self.elastic_factor)
        return PlanningRod(
            stiffness_factor=fraction, friction_factor=1.0 / fraction, yield_curvature_1_m=self.yield_curvature_1_m
        )


def try_goal(
    model: BelievedDlo,
    belief: DloBelief,
    goal_world: Float64Array,
    threshold_m: float,
    config: FeasibilityConfig,
    posts: Float64Array = NO_POSTS,
) -> HoldVerdict:
    """Release the rod in a goal (M, 3) [m]; if it does not hold, search for the nearest shape that does.

    `model` is the rod of `belief`, with which actions are planned; `posts` (P, 8) are from `Scene.posts_world`.
    """
    may_be, allowed_m = plausible(belief), config.hold_fraction * threshold_m
    releases = tuple(release(model, goal_world, one, posts) for one in may_be)
    best_m, too_tight = min(each.rmse_m for each in releases), bool(bends(goal_world, config))
    if best_m > threshold_m or too_tight:
        led_m = attainable_rmse_m(belief, goal_world, config, _supported(model, goal_world, posts))
        best_m = led_m if too_tight else min(best_m, led_m)
    if all(each.rmse_m <= allowed_m for each in releases) and not too_tight:
        return HoldVerdict(releases, best_m, fit_length(model, goal_world))
    return HoldVerdict(releases, best_m, _nearest_held(model, belief, goal_world, allowed_m, config, posts))


def attainable_rmse_m(
    belief: DloBelief, goal_world: Float64Array, config: FeasibilityConfig, supported: BoolArray | None = None
) -> float:
    """Smallest RMSE [m] between a goal (M, 3) [m] and a shape that holds and bends no tighter than allowed.

    Nodes that are `supported` (M,) by a post need no friction.
    """
    softest = min(one.elastic_factor for one in plausible(belief)) * belief.elastic_m3.value
    # A plastic DLO can be overbent and springs back to any shape: friction need not hold it.
    springs_back = belief.yield_curvature_1_m is None and belief.takes_set <= LARGEST_SET_PROBABILITY
    elastic_m3 = softest if springs_back else 0.0
    radius_m = config.min_bend_radius_m
    return nearest_static(goal_world, elastic_m3, min_radius_m=radius_m, supported=supported).rmse_m


def _supported(model: BelievedDlo, goal_world: Float64Array, posts: Float64Array) -> BoolArray | None:
    """The nodes (M,) of a goal (M, 3) [m] that may lean on a post; None without posts.

    How much a post bears depends on the shape that is sought, so friction need not hold these nodes at all: the bound
    stays a lower one.
    """
    if not len(posts):
        return None
    apart_m = np.linalg.norm(goal_world[:, None, :2] - posts[:, :2], axis=2) - posts[:, 6] - model.radius_m  # (M, P)
    return np.asarray((apart_m < _LEANS_M).any(axis=1))


def plausible(belief: DloBelief) -> tuple[Plausible, ...]:
    """The rods that are released: with the assumed parameters first, then stiffest, softest, and between."""
    return tuple(
        Plausible(
            elastic_factor=math.exp(fraction * _UNCERTAIN_SDS * belief.elastic_m3.log_sd),
            yield_curvature_1_m=(belief.yield_curvature_1_m or math.inf) * _YIELD_UNCERTAINTY**fraction,
        )
        for fraction in _SPREAD
    )


def release(model: BelievedDlo, goal_world: Float64Array, rod: Plausible, posts: Float64Array = NO_POSTS) -> Release:
    """Place the rod in a goal (M, 3) [m] among posts (P, 8), release it, and measure how far it springs back."""
    nodes = settle(model, goal_world, rod.planning_rod, posts)
    moved_m = np.linalg.norm(nodes - goal_world, axis=1)
    node = int(moved_m.argmax())
    return Release(
        elastic_factor=rod.elastic_factor,
        nodes_world=nodes,
        rmse_m=geometry.rmse_m(nodes, goal_world),
        node=node,
        largest_m=float(moved_m[node]),
    )


def _nearest_held(
    model: BelievedDlo,
    belief: DloBelief,
    goal_world: Float64Array,
    allowed_m: float,
    config: FeasibilityConfig,
    posts: Float64Array,
) -> Float64Array | None:
    """The nearest shape found (M, 3) [m] that holds for all assumed parameters.

    The search uses the stiffest rod with decreasing friction, because a rod rolls more easily than it slides.
    """
    may_be = plausible(belief)
    stiffest = max(may_be, key=lambda one: one.elastic_factor)
    elastic_m3 = stiffest.elastic_factor * belief.elastic_m3.value
    for fraction in _NEAREST_FRACTIONS:
        held = nearest_static(
            goal_world,
            elastic_m3 / fraction,
            min_radius_m=config.min_bend_radius_m,
            yield_curvature_1_m=stiffest.yield_curvature_1_m,
        )
        # The worst case comes first, because it usually decides.
        if all(release(model, held.nodes_world, one, posts).rmse_m <= allowed_m for one in (stiffest, *may_be)):
            return held.nodes_world
    return None


TryGoal = Callable[[Float64Array], Awaitable[HoldVerdict]]
"""Releases the rod in a goal (M, 3) [m]; takes as long as a few simulated seconds."""

INFEASIBLE_FACTOR = 1.1
"""A goal is infeasible if no shape within this multiple of the threshold holds; more than 1, because the search finds a
local optimum."""


async def judge(goal: GoalShape, threshold_m: float, *, place: Workplace, try_goal: TryGoal) -> GoalVerdict:
    """Judge a goal for the DLO of `place`, to be met to an RMSE of `threshold_m` [m].

    It holds when there is no finding. It is infeasible if no shape within the threshold holds, even for the softest
    plausible rod on the roughest plausible table, or if it overlaps a fixture; otherwise it is doubtful. A goal that
    crosses itself is tested as if strands could pass through each other: it is refused only if no open shape is near.
    """
    nodes = goal.nodes_world
    outside = out_of_bounds(nodes, place)
    across = overlaps(nodes, place.dlo.radius_m)
    bent = bends(nodes, place.config)
    in_fixtures = overlaps_fixtures(nodes, place)
    apart_m = untangling_rmse_m(nodes, list(crossings(nodes[:, :2])), place.dlo.radius_m) if across else 0.0
    hold = None if apart_m > threshold_m else await try_goal(nodes)
    sprung = () if hold is None else _springs_back(hold, nodes, threshold_m, place)
    findings = (
        *outside,
        *(_of_goal(finding, nodes, apart_m, threshold_m) for finding in across),
        *in_fixtures,
        *bent,
        *misfits(nodes, place.dlo.length_m),
        *sprung,
        *crowded(nodes, place),
    )
    infeasible = (
        hold is None
        or bool(in_fixtures)
        or hold.attainable_rmse_m > INFEASIBLE_FACTOR * threshold_m
        or (bool(outside) and unreachable_rmse_m(nodes, place) > threshold_m)
    )
    nearest = None if hold is None or not findings else _nearest(hold, place)
    return GoalVerdict(
        stamp_ns=goal.stamp_ns,
        standing=_standing(findings, infeasible=infeasible),
        threshold_m=threshold_m,
        goal_world=nodes,
        findings=findings,
        releases=() if hold is None else hold.releases,
        nearest_world=nearest,
        nearest_rmse_m=None if nearest is None else geometry.rmse_m(nearest, nodes),
    )


def _of_goal(across: Finding, nodes: Float64Array, apart_m: float, threshold_m: float) -> Finding:
    """Refuse a self-crossing goal if no open shape is within the threshold; otherwise it is doubtful."""
    near = apart_m <= threshold_m
    apart = f" (strands {across.amount * 1000.0:.1f} mm apart, diameter {across.limit * 1000.0:.1f} mm)"
    text = (
        f"The goal lies across or upon itself at {place_of(nodes, across.node)}{apart if across.limit else ''}; "
        f"the DLO can only be laid open. The nearest open shape is about {apart_m * 1000.0:.1f} mm (RMSE) from it, "
        f"{'within' if near else 'more than'} "
        f"the threshold of {threshold_m * 1000.0:.4g} mm: "
        + ("the arm may end in an open shape beside the goal." if near else "the goal is refused; lay it open.")
    )
    return msgspec.structs.replace(across, text=text)


def _standing(findings: tuple[Finding, ...], *, infeasible: bool) -> Standing:
    if infeasible:
        return Standing.INFEASIBLE
    return Standing.DOUBTFUL if findings else Standing.HOLDS


def _nearest(hold: HoldVerdict, place: Workplace) -> Float64Array | None:
    """The nearest shape that holds (M, 3) [m], moved onto table, view and reach; None if another limit forbids it."""
    if hold.nearest_world is None:
        return None
    if place.scene.posts:  # posts may hold it, and only where they stand
        moved = hold.nearest_world if is_within_bounds(hold.nearest_world, place) else None
    else:
        moved = moved_within_bounds(hold.nearest_world, lambda nodes: is_within_bounds(nodes, place))
    if moved is None or overlaps(moved, place.dlo.radius_m) or bends(moved, place.config):
        return None
    if overlaps_fixtures(moved, place):
        return None
    return None if misfits(moved, place.dlo.length_m) or crowded(moved, place) else moved


def _springs_back(hold: HoldVerdict, nodes: Float64Array, threshold_m: float, place: Workplace) -> tuple[Finding, ...]:
    believed, worst = hold.releases[0], max(hold.releases, key=lambda release: release.rmse_m)
    allowed_m = place.config.hold_fraction * threshold_m
    if worst.rmse_m <= allowed_m:
        return ()
    text = (
        f"Released there the DLO springs back by {believed.rmse_m * 1000.0:.1f} mm (RMSE), farthest by "
        f"{believed.largest_m * 1000.0:.1f} mm at {place_of(nodes, believed.node)}; by up to "
        f"{worst.rmse_m * 1000.0:.1f} mm (RMSE) as far as its stiffness and friction are in doubt. The limit is "
        f"{allowed_m * 1000.0:.3g} mm. Use wider bends, or a larger threshold."
    )
    return (length_finding(Problem.SPRINGS_BACK, believed.node, worst.rmse_m, allowed_m, text),)
