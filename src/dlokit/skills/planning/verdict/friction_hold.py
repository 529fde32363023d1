"""Predicts whether friction holds a goal: how far the rod springs back after its release, and which near shape holds.

The rod's parameters are uncertain. Each goal is simulated with rods from the stiffest on the smoothest table to the
softest on the roughest. The budget is counted in releases, not in seconds.
"""

import math
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.equilibrium import nearest_static
from dlokit.rod.nodes import fit_length
from dlokit.rod.rollout import PlanningRod, settle
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict.feasibility import bends
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief
from dlokit.types.feasibility import Release

SET_DOUBT = 0.05
"""A goal can be infeasible because of spring-back only if the probability of a plastic DLO is at most this."""
_DOUBT_SDS = 2.0  # standard deviations of EI / (μ w) that the releases cover on either side
_YIELD_DOUBT = 1.5  # uncertainty of the yield curvature, as a factor
_NEAREST_SHARES = (0.75, 0.5, 0.35)
"""Fractions of friction for the search of the nearest shape, tried until one holds in all releases."""
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
    """A rod that the DLO may be."""

    elastic_factor: float
    """Its EI / (μ w) over the believed one."""
    yield_curvature_1_m: float
    """Yield curvature [1/m]; infinite: elastic."""

    @property
    def quick(self) -> PlanningRod:
        """The same relative to the model: half of it stiffness, half friction."""
        share = math.sqrt(self.elastic_factor)
        return PlanningRod(
            stiffness_share=share, friction_share=1.0 / share, yield_curvature_1_m=self.yield_curvature_1_m
        )


def try_goal(
    model: BelievedDlo, belief: DloBelief, goal_world: Float64Array, threshold_m: float, config: FeasibilityConfig
) -> HoldVerdict:
    """Release the rod in a goal (M, 3) [m]; if it does not hold, search for the nearest shape that does.

    `model` is the rod of `belief`, with which actions are planned.
    """
    may_be, allowed_m = plausible(belief), config.hold_fraction * threshold_m
    releases = tuple(release(model, goal_world, one) for one in may_be)
    best_m, too_tight = min(each.rmse_m for each in releases), bool(bends(goal_world, config))
    if best_m > threshold_m or too_tight:
        led_m = attainable_rmse_m(belief, goal_world, config)
        best_m = led_m if too_tight else min(best_m, led_m)
    if all(each.rmse_m <= allowed_m for each in releases) and not too_tight:
        return HoldVerdict(releases, best_m, fit_length(model, goal_world))
    return HoldVerdict(releases, best_m, _nearest(model, belief, goal_world, allowed_m, config))


def attainable_rmse_m(belief: DloBelief, goal_world: Float64Array, config: FeasibilityConfig) -> float:
    """Smallest RMSE [m] between a goal (M, 3) [m] and a shape that holds and bends no tighter than allowed."""
    softest = min(one.elastic_factor for one in plausible(belief)) * belief.elastic_m3.value
    # A plastic DLO can be overbent and springs back to any shape: friction need not hold it.
    springs_back = belief.yield_curvature_1_m is None and belief.takes_set <= SET_DOUBT
    elastic_m3 = softest if springs_back else 0.0
    return nearest_static(goal_world, elastic_m3, min_radius_m=config.min_bend_radius_m).rmse_m


def plausible(belief: DloBelief) -> tuple[Plausible, ...]:
    """The rods that are released: with the assumed parameters first, then stiffest, softest, and between."""
    return tuple(
        Plausible(
            elastic_factor=math.exp(share * _DOUBT_SDS * belief.elastic_m3.log_sd),
            yield_curvature_1_m=(belief.yield_curvature_1_m or math.inf) * _YIELD_DOUBT**share,
        )
        for share in _SPREAD
    )


def release(model: BelievedDlo, goal_world: Float64Array, rod: Plausible) -> Release:
    """Place the rod in a goal (M, 3) [m], release it, and measure how far it springs back."""
    nodes = settle(model, goal_world, rod.quick)
    moved_m = np.linalg.norm(nodes - goal_world, axis=1)
    node = int(moved_m.argmax())
    return Release(
        elastic_factor=rod.elastic_factor,
        nodes_world=nodes,
        rmse_m=geometry.rmse_m(nodes, goal_world),
        node=node,
        largest_m=float(moved_m[node]),
    )


def _nearest(
    model: BelievedDlo, belief: DloBelief, goal_world: Float64Array, allowed_m: float, config: FeasibilityConfig
) -> Float64Array | None:
    """The nearest shape found (M, 3) [m] that holds for all assumed parameters.

    The search uses the stiffest rod with decreasing friction, because a rod rolls more easily than it slides.
    """
    may_be = plausible(belief)
    stiffest = max(may_be, key=lambda one: one.elastic_factor)
    elastic_m3 = stiffest.elastic_factor * belief.elastic_m3.value
    for share in _NEAREST_SHARES:
        held = nearest_static(
            goal_world,
            elastic_m3 / share,
            min_radius_m=config.min_bend_radius_m,
            yield_curvature_1_m=stiffest.yield_curvature_1_m,
        )
        # The worst case comes first, because it usually decides.
        if all(release(model, held.nodes_world, one).rmse_m <= allowed_m for one in (stiffest, *may_be)):
            return held.nodes_world
    return None
