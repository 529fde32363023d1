"""Tracking from cloud to cloud: cleans the cloud, calls the strategy, checks its result. Pure."""

import logging
import math
from dataclasses import dataclass

import msgspec
import numpy as np
import scipy

from dlokit.errors import SkillFailure, raise_interrupt
from dlokit.geometry import rmse_m
from dlokit.skills.observer.anchored import is_chain
from dlokit.skills.observer.base import ObserverStrategy, memory_flaw, without_memory
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.initialise.first_shape import ISOLATION_RADIUS_M, LENGTH_TOLERANCE, initial_targets
from dlokit.skills.observer.visibility import RADIUS_M, distance_to_dlo_m, kept, thickness
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import DistrustReason, Observation

MOST_POINTS = 20_000
"""Larger clouds are thinned to this many points, drawn evenly."""
_LEAST_POINTS = 10
"""A cloud with fewer points is not used."""
ELSEWHERE_M = 0.01
"""A cloud ordered without a prior is preferred where it differs from the targets by more than this [m], root mean
square."""
FOUND_AGAIN_HEALTH = 0.5
"""Targets of a rod that was lost and found again have at most this health."""
SHORTEST_FRACTION = 0.85
"""Targets shorter than this fraction of the DLO's length are not trusted. A registration of a rod that is visible from
end to end has 0.91 and more (`som`, which ends inside the tips); one that folds a hidden part has less."""
UNUSABLE_HEALTH = 0.25
"""Targets of less health are not used: the last state is kept, not visible, with growing uncertainty."""


def cleaned(seen: Observation, most_points: int = MOST_POINTS) -> Observation:
    """The observation with at most `most_points` of its finite points, drawn evenly."""
    points = seen.points_world
    usable = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(usable) > most_points:
        usable = np.unique(usable[np.random.default_rng(0).integers(0, len(usable), most_points)])
    if len(usable) == len(points):
        return seen
    return msgspec.structs.replace(seen, points_world=points[usable])


def near(seen: Observation, prior: DloState, reach_m: float) -> Observation:
    """The observation without points that are more than `reach_m` outside the box around the prior's nodes."""
    low, high = prior.nodes_world.min(axis=0) - reach_m, prior.nodes_world.max(axis=0) + reach_m
    inside = np.all((seen.points_world >= low) & (seen.points_world <= high), axis=1)
    return seen if inside.all() else msgspec.structs.replace(seen, points_world=seen.points_world[inside])


def distrust_of(seen: Observation, near_ones: Observation, prior: DloState) -> DistrustReason | None:
    """Reason why a cleaned cloud with `near_ones` near the prior cannot be used, or None."""
    if prior.observed_stamp_ns > 0 and seen.stamp_ns <= prior.observed_stamp_ns:
        return DistrustReason.OLD_STAMP
    if len(seen.points_world) < _LEAST_POINTS:
        return DistrustReason.NO_POINTS
    if len(near_ones.points_world) < max(0.5 * len(seen.points_world), _LEAST_POINTS):
        return DistrustReason.FAR_POINTS
    return None


log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Followed:
    """The answer to one cloud."""

    targets: TargetPoints
    distrust: DistrustReason | None
    """Reason why the targets are not used, or None."""


def followed(
    strategy: ObserverStrategy,
    seen: Observation,
    prior: DloState,
    config: ObserverConfig,
    radius_m: float = RADIUS_M,
) -> Followed:
    """The strategy's targets; where they lost the DLO and the cloud shows all of it, the cloud is ordered again.

    A cloud that cannot be used, or shows nothing of the DLO, leaves the prior as it is: not visible, health 0, with a
    covariance that grows with the time, and with its memory. A strategy that fails or loses the DLO begins again
    without a memory. `radius_m` [m] is the DLO's.
    """
    usable = cleaned(seen)
    around = near(usable, prior, config.reach_m)
    distrust = distrust_of(usable, around, prior)
    if distrust is not None:
        return Followed(targets=kept(seen.stamp_ns, prior, config.drift_m_s), distrust=distrust)
    targets = _estimated(strategy, around, prior)
    if isinstance(targets, DistrustReason):
        return Followed(targets=without_memory(kept(seen.stamp_ns, prior, config.drift_m_s)), distrust=targets)
    found = _elsewhere(targets, around, prior, config, radius_m)
    if found is not None:
        return Followed(targets=found, distrust=DistrustReason.ELSEWHERE)
    if targets.health < UNUSABLE_HEALTH:
        return Followed(targets=kept(seen.stamp_ns, prior, config.drift_m_s), distrust=DistrustReason.NOT_THE_DLO)
    if targets.health < config.lost_health:
        return Followed(targets=targets, distrust=DistrustReason.LOW_HEALTH)
    return Followed(targets=targets, distrust=DistrustReason.SHORTENED if _shortened(targets, prior.topology) else None)


def _shortened(targets: TargetPoints, topology: Topology) -> bool:
    """Whether the rod through the targets is too short for the DLO; a branched one may have rough rest lengths."""
    if not is_chain(topology):
        return False
    length_m = np.sum(np.linalg.norm(np.diff(targets.nodes_world, axis=0), axis=1))
    return bool(length_m < SHORTEST_FRACTION * np.sum(topology.rest_lengths_m))


def _estimated(strategy: ObserverStrategy, seen: Observation, prior: DloState) -> TargetPoints | DistrustReason:
    """The strategy's targets; the reason when it fails or returns targets or a memory that are invalid."""
    count = len(prior.nodes_world)
    try:
        targets = strategy.estimate(seen, prior)
        if (flaw := memory_flaw(targets.memory)) is not None:
            log.error("the strategy's targets are refused: %s", flaw)
            return DistrustReason.BAD_MEMORY
        valid = (
            targets.nodes_world.shape == (count, 3)
            and bool(np.isfinite(targets.nodes_world).all())
            and (targets.visible.shape, targets.visible.dtype) == ((count,), np.bool_)
            and (targets.covariance is None or targets.covariance.shape == (count, 3, 3))
            and bool(np.isfinite(targets.health))
        )
    except Exception as error:  # a strategy may be external, and its failure on one cloud must not end the run
        raise_interrupt(error)
        log.exception("the strategy failed; the last state is kept")
        return DistrustReason.BAD_TARGETS
    return targets if valid else DistrustReason.BAD_TARGETS


_COUNTED_POINTS = 200
"""Number of evenly drawn points from which the point density on the DLO is estimated."""
_DENSE_FRACTION = 0.25
"""A point with fewer than this fraction of the usual number of neighbours is an outlier, as in the first order."""


def _may_be_elsewhere(targets: TargetPoints, seen: Observation, topology: Topology, thick: float) -> bool:
    """Whether ordering the cloud without a prior can find a whole rod away from targets with hidden nodes.

    Ordering costs ten times as much as a strategy. It can find one if the cloud has points beside the targets, or if a
    tip of the targets is outside the cloud and the hidden part is within the tolerance of the rod's length: then the
    targets have slid.
    """
    hidden = ~targets.visible
    few = np.count_nonzero(hidden) <= math.ceil(LENGTH_TOLERANCE * len(topology.edges)) + 1
    slid = bool(few and (hidden[0] or hidden[-1]))
    return slid or _rod_beside(targets, seen, topology, thick)


def _rod_beside(targets: TargetPoints, seen: Observation, topology: Topology, thick: float) -> bool:
    """Whether points as dense as those on the DLO are farther than `ELSEWHERE_M` from the targets' line.

    Ordering a cloud without a prior also omits isolated points. Lengths grow by the factor `thick`.
    """
    points = seen.points_world.astype(np.float64)
    beside = points[distance_to_dlo_m(points, targets.nodes_world, topology) > ELSEWHERE_M * thick]
    if len(beside) == 0:
        return False
    tree, radius_m = scipy.spatial.KDTree(points), ISOLATION_RADIUS_M * thick
    drawn = points[:: max(len(points) // _COUNTED_POINTS, 1)]
    usual = float(np.median(tree.query_ball_point(drawn, radius_m, return_length=True)))
    counts = np.asarray(tree.query_ball_point(beside, radius_m, return_length=True))
    return bool(np.any(counts > _DENSE_FRACTION * usual))


def _elsewhere(
    targets: TargetPoints, seen: Observation, prior: DloState, config: ObserverConfig, radius_m: float
) -> TargetPoints | None:
    """The cloud ordered without a prior, when uncertain targets disagree with the cloud.

    Targets are uncertain when their health is low, or when nodes are hidden although the cloud may show the whole rod
    without a gap (`_may_be_elsewhere`): a folded registration looks like a rod with a hidden part. A rod of full length
    that is found away from the targets replaces them. Its order is the one nearer to the prior's, and its health at
    most `FOUND_AGAIN_HEALTH`.
    """
    low = targets.health < config.lost_health
    thick = thickness(radius_m)
    if not is_chain(prior.topology):
        return None
    if not low and (targets.visible.all() or not _may_be_elsewhere(targets, seen, prior.topology, thick)):
        return None
    length_m = float(np.sum(prior.topology.rest_lengths_m))
    try:
        found = initial_targets(seen, len(prior.nodes_world), length_m, prior.nodes_world, radius_m)
    except SkillFailure:
        return None
    if not low and not found.visible.all():
        return None
    elsewhere = rmse_m(found.nodes_world, targets.nodes_world) > ELSEWHERE_M * thick
    if not elsewhere or found.health < min(targets.health, config.lost_health):
        return None
    return msgspec.structs.replace(found, health=min(found.health, FOUND_AGAIN_HEALTH))
