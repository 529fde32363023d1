"""Whether friction holds a goal: released there, how far does the rod spring back, and which shape near it holds?

What the rod is, is a belief. Each goal is tried on the rods that it may be, from as stiff on as smooth a table to as
soft on as rough a one as may be. The budget is counted in trials, not in seconds.
"""

import math
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.equilibrium import nearest_held
from dlokit.rod.nodes import fit_length
from dlokit.rod.rollout import QuickRod, settle
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.verdict.feasibility import bends
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief
from dlokit.types.feasibility import Release

SET_DOUBT = 0.05
"""A goal can be hopeless for springing back where the chance that the DLO keeps bends is no more than this."""
_DOUBT_SDS = 2.0  # standard deviations of what is believed of EI / (μ w), by which the DLO may be other, to either side
_YIELD_DOUBT = 1.5  # factor by which the curvature where the DLO yields may be other than believed
_NEAREST_SHARES = (0.75, 0.5, 0.35)  # of friction, with which the nearest shape is sought until one holds in all trials
_SPREAD = (0.0, 1.0, -1.0, 0.5, -0.5)  # of the doubt: believed, stiffest, softest, between


@dataclass(frozen=True)
class HoldVerdict:
    """What the trials say of a goal."""

    releases: tuple[Release, ...]
    """As believed, stiffest, softest, between."""
    attainable_rmse_m: float
    """How near to the goal some shape holds, if the rod is as soft and the table as rough as may be [m]."""
    nearest_world: Float64Array | None  # (M, 3) [m]
    """The nearest shape found that holds whatever of the doubts is right, wherever on the table: the goal itself, at
    the rod's length, where that does. None: none was found."""


@dataclass(frozen=True, kw_only=True)
class Plausible:
    """A rod that the DLO may be."""

    elastic_factor: float
    """Its EI / (μ w) over the believed one."""
    yield_curvature_1_m: float
    """Curvature beyond which it keeps a bend [1/m]; infinite: it always springs back."""

    @property
    def quick(self) -> QuickRod:
        """The same against the model: half of it stiffness, half friction."""
        share = math.sqrt(self.elastic_factor)
        return QuickRod(stiffness_share=share, friction_share=1.0 / share, yield_curvature_1_m=self.yield_curvature_1_m)


def try_goal(
    model: BelievedDlo, belief: DloBelief, goal_world: Float64Array, threshold_m: float, config: FeasibilityConfig
) -> HoldVerdict:
    """Release the rod in a goal (M, 3) [m], and where that does not hold look for the nearest shape that does.

    `model` is the rod of `belief`: the one that actions are planned with.
    """
    may_be, allowed_m = plausible(belief), config.hold_share * threshold_m
    releases = tuple(release(model, goal_world, one) for one in may_be)
    best_m, too_tight = min(trial.rmse_m for trial in releases), bool(bends(goal_world, config))
    if best_m > threshold_m or too_tight:
        led_m = attainable_rmse_m(belief, goal_world, config)
        best_m = led_m if too_tight else min(best_m, led_m)
    if all(trial.rmse_m <= allowed_m for trial in releases) and not too_tight:
        return HoldVerdict(releases, best_m, fit_length(model, goal_world))
    return HoldVerdict(releases, best_m, _nearest(model, belief, goal_world, allowed_m, config))


def attainable_rmse_m(belief: DloBelief, goal_world: Float64Array, config: FeasibilityConfig) -> float:
    """How near to a goal (M, 3) [m] some shape holds that bends no tighter than allowed, at best [m]."""
    softest = min(one.elastic_factor for one in plausible(belief)) * belief.elastic_m3.value
    # What keeps a bend can be bent further and comes back to any shape: friction need not hold it.
    springs_back = belief.yield_curvature_1_m is None and belief.takes_set <= SET_DOUBT
    elastic_m3 = softest if springs_back else 0.0
    return nearest_held(goal_world, elastic_m3, min_radius_m=config.min_bend_radius_m).rmse_m


def plausible(belief: DloBelief) -> tuple[Plausible, ...]:
    """The rods that the DLO may be: as believed first, then stiffest, softest, and between."""
    return tuple(
        Plausible(
            elastic_factor=math.exp(share * _DOUBT_SDS * belief.elastic_m3.log_sd),
            yield_curvature_1_m=(belief.yield_curvature_1_m or math.inf) * _YIELD_DOUBT**share,
        )
        for share in _SPREAD
    )


def release(model: BelievedDlo, goal_world: Float64Array, rod: Plausible) -> Release:
    """Lay the rod down as a goal (M, 3) [m], let go, and measure how far it springs back."""
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
    """The nearest shape found (M, 3) [m] that holds whatever of the doubts is right.

    It is sought for the stiffest rod with ever less of the friction, for a rod rolls more easily than it slides.
    """
    may_be = plausible(belief)
    stiffest = max(may_be, key=lambda one: one.elastic_factor)
    elastic_m3 = stiffest.elastic_factor * belief.elastic_m3.value
    for share in _NEAREST_SHARES:
        held = nearest_held(
            goal_world,
            elastic_m3 / share,
            min_radius_m=config.min_bend_radius_m,
            yield_curvature_1_m=stiffest.yield_curvature_1_m,
        )
        # The worst comes first: mostly it decides alone.
        if all(release(model, held.nodes_world, one).rmse_m <= allowed_m for one in (stiffest, *may_be)):
            return held.nodes_world
    return None
