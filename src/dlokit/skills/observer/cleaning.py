"""What a cloud must be before a strategy sees it: numbers, not too many, near where the DLO was."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation
from dlokit.types.observer_event import Doubt

Flags = NDArray[np.bool_]


def cleaned(seen: Observation, most_points: int) -> Observation:
    """The observation without points that are no numbers, and at most `most_points` of the others, drawn evenly."""
    points = seen.points_world
    usable = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(usable) > most_points:
        usable = np.unique(usable[np.random.default_rng(0).integers(0, len(usable), most_points)])
    if len(usable) == len(points):
        return seen
    return msgspec.structs.replace(seen, points_world=points[usable])


def near(seen: Observation, prior: DloState, reach_m: float) -> Observation:
    """The observation without points farther than `reach_m` outside the box around the prior's nodes."""
    low, high = prior.nodes_world.min(axis=0) - reach_m, prior.nodes_world.max(axis=0) + reach_m
    inside = np.all((seen.points_world >= low) & (seen.points_world <= high), axis=1)
    return seen if inside.all() else msgspec.structs.replace(seen, points_world=seen.points_world[inside])


def doubt_of(seen: Observation, near_ones: Observation, prior: DloState, least_points: int) -> Doubt | None:
    """Why a cleaned cloud, of which `near_ones` lie near the prior, cannot be used; None when it can."""
    if prior.observed_stamp_ns > 0 and seen.stamp_ns <= prior.observed_stamp_ns:
        return Doubt.OLD_STAMP
    if len(seen.points_world) < least_points:
        return Doubt.NO_POINTS
    if len(near_ones.points_world) < max(0.5 * len(seen.points_world), least_points):
        return Doubt.FAR_POINTS
    return None
