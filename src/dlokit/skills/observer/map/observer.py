"""The most probable nodes given the cloud and a model of the rod: an iterated Gauss-Newton MAP with a banded solve.

Each cloud takes two stages (`stages`), whose steps solve H x = b of `terms`. The coarse stage assigns points to nodes
softly, with a Gaussian that narrows. The fine stage places nodes along the rod by the seen tips, and assigns points to
segments within a window of arc length, with less weight for outliers. H also gives each node's covariance (`trust`).
docs/explanations/map-observer.md explains the method.

The problem has additional nodes on a cubic spline through the given ones; only the given ones are returned.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from dlokit.ranges import Count, Positive, check_ranges
from dlokit.rod.believed import BelievedDlo, in_a_row
from dlokit.skills.observer.anchored import is_chain
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.cpd import PLIABLE, register, register_visible
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.visibility import thickness
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import GripperPin, Observation


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """The most probable rod: stiff lengths, coherent motion, seen tips; estimates the uncertainty of each node."""

    name: ClassVar[str] = "map"

    noise_m: Positive = 0.002
    """Standard deviation of the cloud's points from the rod [m], multiplied for a radius above 4 mm. Larger: smoother
    shapes, fewer points are outliers."""
    widest_m: Positive = 0.05
    """Largest motion of the rod between two clouds [m]. Larger: faster motion is followed, and a fold of the rod onto
    itself becomes more likely."""
    max_points: Count = 1000
    """Most points of a cloud that are used; larger clouds are thinned. Larger: more accurate and slower."""

    def __post_init__(self) -> None:
        check_ranges(self, "observer.strategy")

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """Build the strategy with these settings."""
        return MapObserver(self, dlo)


LONGEST_EDGE_M = 0.02
"""Chains with longer edges are refined [m]."""


def refinement(prior: DloState, longest_edge_m: float) -> int:
    """Number of pieces into which each edge must be cut so that no piece is longer than `longest_edge_m`."""
    return max(int(np.ceil(float(np.mean(prior.topology.rest_lengths_m)) / longest_edge_m)), 1)


def refined(prior: DloState, pieces: int) -> DloState:
    """The prior with each edge of its chain cut into `pieces` of equal rest length."""
    if pieces == 1:
        return prior
    rest = np.repeat(prior.topology.rest_lengths_m / pieces, pieces)
    at = np.concatenate(([0.0], np.cumsum(rest)))
    spline = scipy.interpolate.CubicSpline(at[::pieces], prior.nodes_world)
    nearest = np.rint(np.arange(len(at)) / pieces).astype(np.int64)
    return DloState(
        stamp_ns=prior.stamp_ns,
        nodes_world=np.asarray(spline(at), dtype=np.float64),
        topology=in_a_row(rest),
        visible=None if prior.visible is None else prior.visible[nearest],
        observed_stamp_ns=prior.observed_stamp_ns,
        health=prior.health,
        covariance=None if prior.covariance is None else prior.covariance[nearest],
    )


def refined_pins(pins: tuple[GripperPin, ...], pieces: int) -> tuple[GripperPin, ...]:
    """The pins, at the same nodes of the refined chain."""
    return tuple(GripperPin(robot=pin.robot, node=pin.node * pieces, position_world=pin.position_world) for pin in pins)


class MapObserver:
    """Coarse stage, fine stage, covariance and health."""

    def __init__(self, config: MapConfig | None = None, dlo: BelievedDlo | None = None) -> None:
        self._config = config or MapConfig()
        self._dlo = dlo or BelievedDlo()

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The most probable nodes in the order of `prior`, their covariance (M, 3, 3) [m²], and health.

        A DLO that is not one chain of at least 4 nodes is registered by coherent point drift, without covariance.
        """
        from dlokit.skills.observer.map.problem import posed
        from dlokit.skills.observer.map.stages import coarse, fine
        from dlokit.skills.observer.map.trust import health, stated_covariance

        config = self._config
        if len(seen.points_world) == 0:
            return nothing_seen(seen, prior)
        if not is_chain(prior.topology) or len(prior.nodes_world) < 4:
            points = seen.points_world.astype("float64")
            first = register(thinned(points, PLIABLE.max_points), prior.nodes_world, PLIABLE)
            return register_visible(points, first, seen, prior, PLIABLE, self._dlo.radius_m)
        pieces = refinement(prior, LONGEST_EDGE_M)
        problem = posed(
            seen,
            refined(prior, pieces),
            refined_pins(seen.pins, pieces),
            radius_m=self._dlo.radius_m,
            noise_m=config.noise_m * thickness(self._dlo.radius_m),
            widest_m=config.widest_m,
            max_points=config.max_points,
        )
        nodes, before = coarse(problem)
        fitted = fine(problem, nodes, before)
        covariance = stated_covariance(problem, before, fitted)
        return TargetPoints(
            stamp_ns=seen.stamp_ns,
            nodes_world=fitted.nodes[::pieces] + problem.origin,
            visible=(fitted.supported & ~fitted.shaded)[::pieces],
            covariance=covariance[::pieces],
            health=health(problem, fitted, covariance),
        )
