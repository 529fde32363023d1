"""The estimation problem of one cloud, and everything that does not depend on the assignment of points."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dlokit.description.table import TABLE_TOP_M
from dlokit.skills.observer.map.terms import ChainSystem, add_coherence, add_lengths, add_place, add_table, coherence
from dlokit.skills.observer.map.view import View, view_of
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.visibility import SEEN_SIGMA_M
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.observation import GripperPin, Observation

LENGTH_SIGMA_M = 0.0001
"""Standard deviation of an edge from its rest length [m]: a rod hardly stretches."""
COARSE_POINTS = 300
"""Largest number of points of the cloud in the coarse stage."""
PLACE_SIGMA_M = 0.3
"""Standard deviation of a node from its previous position [m]; weak, so that it decides only without other terms."""
_PIN_SIGMA_M = 0.0001
"""Standard deviation of a held node from its gripper [m]."""
_TABLE_SIGMA_M = 0.0001
"""Standard deviation of a node's depth below the table top [m]."""
_LEAST_MOTION_M = 0.005
"""Least assumed motion of the rod since the last cloud [m]."""
_BELOW_TABLE_M = 0.02
"""Points this far below the assumed table show that there is no table [m]; ten times the noise."""
_FRACTION_BELOW_TABLE = 0.1
"""Largest fraction of the points below the table if there is one; outliers, a fifth of a cloud, are on both sides."""


@dataclass(frozen=True, kw_only=True)
class MapProblem:
    """One cloud with the prior knowledge; positions about `origin`."""

    view: View | None
    """The camera; None if unknown."""
    noise_m: float
    """Standard deviation of the cloud's points from the rod [m]."""
    radius_m: float
    """Radius of the rod [m]: the least height of nodes above the table."""
    origin: Float64Array
    """(3,) [m] in the world."""
    points: Float64Array
    """(N, 3) [m], thinned."""
    before: Float64Array
    """The previous nodes (M, 3) [m]."""
    variance_before: Float64Array
    """Total variance of the previous nodes (M,) [m²]; inf if unknown."""
    rod_m: Float64Array
    """Arc length of the nodes on the rod (M,) [m]."""
    rest_m: Float64Array
    """Rest lengths (M - 1,) [m]."""
    K_d: Float64Array
    K_x: Float64Array
    """Coherence and bending, as `terms.coherence` gives them (M, 3)."""
    moved_m: float
    """Distance that the rod moved since the last cloud [m]: `moved_since`, or the motion of its grippers."""
    pins: tuple[tuple[int, Float64Array], ...]
    """Held nodes and their positions (3,) [m]."""
    floor_m: float
    """Lowest z of a node [m]; -inf if there is no table."""

    def shaded(self, positions: Float64Array) -> BoolArray:
        """Whether each position (K, 3) [m] is known to be hidden: out of the picture or behind the robot, (K,)."""
        return np.zeros(len(positions), dtype=np.bool_) if self.view is None else self.view.shaded(positions)

    def hidden(self, nodes: Float64Array, alone: BoolArray) -> BoolArray:
        """Whether each node (M, 3) [m] is known to be hidden, (M,); by the rod itself only nodes `alone` (M,)."""
        shaded = self.shaded(nodes)
        if self.view is None or not np.any(alone & ~shaded):
            return shaded
        return shaded | (alone & self.view.behind_itself(nodes, self.radius_m))


def posed(
    seen: Observation,
    prior: DloState,
    held: tuple[GripperPin, ...],
    *,
    radius_m: float,
    noise_m: float,
    widest_m: float,
    max_points: int,
) -> MapProblem:
    """The problem of one cloud with at least one point, for a rod of `radius_m` [m].

    Its points have a standard deviation of `noise_m` [m] from the rod, which moved by at most `widest_m` [m] since the
    last cloud; `max_points` of them are used.
    """
    origin = prior.nodes_world.mean(axis=0)
    before = prior.nodes_world - origin
    pins = tuple((pin.node, np.asarray(pin.position_world, dtype=np.float64) - origin) for pin in held)
    carried = max((float(np.linalg.norm(place - before[node])) for node, place in pins), default=0.0)
    points = thinned(np.asarray(seen.points_world, dtype=np.float64), max_points) - origin
    rest = np.array(prior.topology.rest_lengths_m, dtype=np.float64)
    K_d, K_x = coherence(len(before), float(np.mean(rest)))
    return MapProblem(
        view=view_of(seen, origin),
        noise_m=noise_m,
        radius_m=radius_m,
        origin=origin,
        points=points,
        before=before,
        variance_before=_variance(prior),
        rod_m=np.concatenate(([0.0], np.cumsum(rest))),
        rest_m=rest,
        K_d=K_d,
        K_x=K_x,
        moved_m=max(moved_since(thinned(points, COARSE_POINTS), before, widest_m), min(carried, widest_m)),
        pins=pins,
        floor_m=_floor_m(points, before, TABLE_TOP_M + radius_m - float(origin[2])),
    )


def _floor_m(points: Float64Array, before: Float64Array, table_m: float) -> float:
    """Lowest z of a node [m]: `table_m`, or -inf if the cloud (N, 3) or the previous nodes (M, 3) [m] are below it.

    Then there is no table, e.g. under a cable between two hands in a frame with another origin.
    """
    deep_m = table_m - _BELOW_TABLE_M
    is_below = np.mean(points[:, 2] < deep_m) > _FRACTION_BELOW_TABLE or bool(np.any(before[:, 2] < deep_m))
    return -np.inf if is_below else table_m


def _variance(prior: DloState) -> Float64Array:
    """Total variance of the prior's nodes (M,) [m²]; inf if unknown.

    Without a covariance, seen nodes have a standard deviation of `SEEN_SIGMA_M`.
    """
    if prior.covariance is not None:
        return np.trace(prior.covariance, axis1=1, axis2=2)
    seen = np.full(len(prior.nodes_world), 3.0 * SEEN_SIGMA_M**2)
    return seen if prior.visible is None else np.where(prior.visible, seen, np.inf)


def moved_since(points: Float64Array, before: Float64Array, widest_m: float) -> float:
    """Distance that the rod moved, within limits [m]: 1.5 times the 80th percentile of the distances to `before`.

    Points (n, 3) show only the motion across the rod, hence the 1.5.
    """
    nearest = np.sort(to_nodes_m(points, before))
    far = nearest[min(int(0.8 * len(nearest)), len(nearest) - 1)]
    return float(min(max(1.5 * far, _LEAST_MOTION_M), widest_m))


@njit(cache=True)
def to_nodes_m(points: Float64Array, nodes: Float64Array) -> Float64Array:
    """Distance (N,) [m] of points (N, 3) to the nearest of the nodes (M, 3)."""
    distance = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        best = np.inf
        for m in range(nodes.shape[0]):
            a, b, c = nodes[m, 0] - points[n, 0], nodes[m, 1] - points[n, 1], nodes[m, 2] - points[n, 2]
            best = min(best, a * a + b * b + c * c)
        distance[n] = np.sqrt(best)
    return distance


def with_priors(
    problem: MapProblem,
    nodes: Float64Array,
    before: Float64Array,
    moved_m: float,
    length_sigma_m: float,
) -> ChainSystem:
    """Normal equations at `nodes` with all terms that do not depend on the cloud; `before` is moved rigidly.

    Both are (M, 3) [m], about the problem's origin. Coherence is
    K = K_d / moved² + I / (M place²): a rod that moved far may also have changed its shape.
    """
    system = ChainSystem(len(nodes))
    K = problem.K_d / moved_m**2
    K[:, 0] += 1.0 / (len(nodes) * PLACE_SIGMA_M**2)
    add_coherence(system.band, system.rhs, before, K, problem.K_x)
    add_lengths(system.band, system.rhs, nodes, problem.rest_m, length_sigma_m)
    add_table(system.band, system.rhs, nodes, problem.floor_m, _TABLE_SIGMA_M)
    for node, place in problem.pins:
        add_place(system.band, system.rhs, node, place, _PIN_SIGMA_M)
    return system
