"""Whether friction holds a goal, tried in the model: released there, how far does the rod spring back, and where to?

The model's stiffness and friction are beliefs. Each goal is tried as believed, then on both sides of it: a stiffer
rod on a smoother table, and a softer one on a rougher table. The budget is counted in trials, not in seconds.
"""

from dataclasses import dataclass, replace

import numpy as np

from dlokit import geometry
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.rod import fit_length
from dlokit.skills.model.settling import Doubt, relax, settle
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Release


@dataclass(frozen=True)
class Hold:
    """What the trials say of a goal."""

    releases: tuple[Release, ...]
    """As believed, at worst, at best."""
    attainable_rmse_m: float
    """How near to the goal some shape holds, if the rod is as soft and the table as rough as may be [m]."""
    nearest_world: Float64Array | None  # (M, 3) [m]
    """The nearest shape found that holds whatever of the doubts is right, wherever on the table: the goal itself, at
    the rod's length, where that does. None: none was found."""


def try_goal(model: ModelConfig, goal_world: Float64Array, threshold_m: float, config: FeasibilityConfig) -> Hold:
    """Release the rod in a goal (M, 3) [m], and where that does not hold look for the nearest shape that does."""
    allowed_m = config.hold_share * threshold_m
    releases = tuple(release(model, goal_world, doubt) for doubt in doubts(config))
    if all(trial.rmse_m <= allowed_m for trial in releases):
        attainable_m = min(trial.rmse_m for trial in releases)
        return Hold(releases=releases, attainable_rmse_m=attainable_m, nearest_world=fit_length(model, goal_world))
    attainable_m = min(geometry.rmse_m(aligned(trial.nodes_world, goal_world), goal_world) for trial in releases)
    if attainable_m > threshold_m:
        # Led back slowly it stops nearer to the goal than let go.
        eased = aligned(relax(doubts(config)[2].of(model), goal_world), goal_world)
        attainable_m = min(attainable_m, geometry.rmse_m(eased, goal_world))
    nearest = _nearest(model, goal_world, releases[1].nodes_world, allowed_m, config)
    return Hold(releases=releases, attainable_rmse_m=attainable_m, nearest_world=nearest)


def doubts(config: FeasibilityConfig) -> tuple[Doubt, Doubt, Doubt]:
    """What the rod may be: as believed; stiffer on a smoother table; softer on a rougher one."""
    stiffer, smoother = config.stiffness_doubt, config.friction_doubt
    return (
        Doubt(),
        Doubt(stiffness_factor=stiffer, friction_factor=smoother),
        Doubt(stiffness_factor=1.0 / stiffer, friction_factor=1.0 / smoother),
    )


def release(model: ModelConfig, goal_world: Float64Array, doubt: Doubt) -> Release:
    """Lay the rod down as a goal (M, 3) [m], let go, and measure how far it springs back."""
    nodes = settle(doubt.of(model), goal_world)
    moved_m = np.linalg.norm(nodes - goal_world, axis=1)
    node = int(moved_m.argmax())
    return Release(
        stiffness_factor=doubt.stiffness_factor,
        friction_factor=doubt.friction_factor,
        nodes_world=nodes,
        rmse_m=geometry.rmse_m(nodes, goal_world),
        node=node,
        largest_m=float(moved_m[node]),
    )


def aligned(nodes_world: Float64Array, goal_world: Float64Array) -> Float64Array:
    """A shape (M, 3) [m] moved and turned on the table to lie nearest to a goal (M, 3) [m].

    A shape that holds does so wherever it lies on a level table (Kabsch, 1976, in the plane).
    """
    middle, goal_middle = nodes_world[:, :2].mean(axis=0), goal_world[:, :2].mean(axis=0)
    shape, goal = nodes_world[:, :2] - middle, goal_world[:, :2] - goal_middle
    turn = np.arctan2(np.sum(shape[:, 0] * goal[:, 1] - shape[:, 1] * goal[:, 0]), np.sum(shape * goal))
    cosine, sine = np.cos(turn), np.sin(turn)
    result = nodes_world.copy()
    result[:, :2] = shape @ np.array([[cosine, sine], [-sine, cosine]]) + goal_middle
    return result


def _nearest(
    model: ModelConfig,
    goal_world: Float64Array,
    sprung_world: Float64Array,
    allowed_m: float,
    config: FeasibilityConfig,
) -> Float64Array | None:
    """The nearest shape found (M, 3) [m] that holds whatever of the doubts is right.

    Tried are where the rod comes to rest when it is led back slowly, and where it sprang to (`sprung_world`, (M, 3)
    [m]); what does not hold springs on, and where to is tried next.
    """
    believed, at_worst, at_best = doubts(config)
    best: Float64Array | None = None
    beyond = replace(at_worst, stiffness_factor=config.nearest_margin * at_worst.stiffness_factor)
    for first in (relax(beyond.of(model), goal_world), sprung_world):
        candidate = aligned(first, goal_world)
        for _ in range(config.nearest_rounds):
            if best is not None and geometry.rmse_m(candidate, goal_world) >= geometry.rmse_m(best, goal_world):
                break
            # The worst comes first: mostly it decides alone.
            trials = (release(model, candidate, doubt) for doubt in (at_worst, believed, at_best))
            failed = next((trial for trial in trials if trial.rmse_m > allowed_m), None)
            if failed is None:
                best = candidate
                break
            candidate = aligned(failed.nodes_world, goal_world)
    return best
