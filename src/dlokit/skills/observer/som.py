"""A self-organising map: the nodes are neurons; each point attracts its nearest neuron and that neuron's neighbours.

Kohonen: *The self-organizing map*, Proc. IEEE 78 (1990), doi 10.1109/5.58325, and its batch form in Kohonen:
*Essentials of the self-organizing map*, Neural Networks 37 (2013), doi 10.1016/j.neunet.2012.09.018. The
paper names Zürn et al., CASE 2021, for its use on DLOs. Limiting the neighbourhood by the error of the map is the idea
of Berglund, Sitte: *The parameterless self-organizing map algorithm*, IEEE Trans. Neural Networks 17 (2006).

Symbols: X (N, 3) the cloud, T (M, 3) the neurons, c(n) the winner of point n, d_ij the distance along the DLO between
nodes i and j, r the radius of the neighbourhood; both in mean edges at rest.
"""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np
import scipy

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.visibility import RADIUS_M, targets_at
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class SomConfig:
    """Self-organising map: no assumption on the motion; nodes spread as evenly as the points do."""

    name: ClassVar[str] = "som"

    initial_radius: float = 4.6
    """r at the first iteration, in mean edges of the DLO: about the number of neighbours that a point moves."""
    final_radius: float = 1.1
    """r at the last iteration, in mean edges; below 0.3 neighbours hardly count."""
    iterations: int = 40
    """Number of updates of the neurons, while r shrinks by a constant factor."""
    misfit_fraction: float = 0.95
    """Quantile of the distances between points and their neurons that limits r, in mean edges."""
    gate_m: float = 0.021
    """Points farther from all neurons than this plus r edges are ignored [m]; several times the noise. The edges, at
    their mean rest length, allow for the shrinkage at the tips by the neighbourhood, and for the motion at first."""
    shrunk: float = 0.74
    """Nodes may be hidden where the total length of the map's edges is below this fraction of the rest length."""
    torn: float = 2.8
    """Nodes may be hidden where an edge of the map is longer than this many times the larger of its rest length and the
    mean rest length of all edges."""
    empty: float = 0.32
    """A node may be hidden if at the prior it wins less than this fraction of the median number of points."""
    max_points: int = 700
    """Most points of a cloud; larger clouds are thinned, evenly over their index."""

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """The strategy with these settings."""
        return Som(self, dlo.radius_m)


def graph_distances(topology: Topology, count: int) -> Float64Array:
    """d (M, M): the shortest distance between nodes along the DLO, of any topology; inf where they are not connected.

    In mean edges at rest, so that on an evenly spaced chain it is the number of edges.
    """
    a, b = topology.edges[:, 0], topology.edges[:, 1]
    steps = np.maximum(topology.rest_lengths_m / topology.rest_lengths_m.mean(), 1e-6)  # 0 would mean no edge
    graph = scipy.sparse.coo_array((steps, (a, b)), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.shortest_path(graph, directed=False), dtype=np.float64)


def neighbourhood(d: Float64Array, radius: float) -> Float64Array:
    """h (M, M) with h_ij = exp(-d_ij² / (2 r²)): weight on node i of a point won by node j."""
    return np.exp(d**2 / (-2.0 * radius**2))


def batch_update(
    X: Float64Array, T: Float64Array, h: Float64Array, winner: Int64Array, near: BoolArray
) -> Float64Array:
    """One step of the batch map: the neurons (M, 3) [m] after it.

    t_i = sum_n h_i,c(n) x_n / sum_n h_i,c(n), over the points that are `near` (N,), with their `winner` (N,). A
    neuron that no point reaches stays.
    """
    won = np.bincount(winner[near], minlength=len(T)).astype(np.float64)
    total = np.column_stack([np.bincount(winner[near], weights=x, minlength=len(T)) for x in X[near].T])
    weight = h @ won
    reached = weight > 1e-9  # of one point
    after = T.copy()
    after[reached] = (h @ total)[reached] / weight[reached, None]
    return after


def points_won(X: Float64Array, T: Float64Array, gate_m: float) -> Float64Array:
    """Number of points within the gate that each neuron wins (M,)."""
    from dlokit.skills.observer.compiled import winners

    winner, distance_m = winners(X, T)
    return np.bincount(winner[distance_m < gate_m], minlength=len(T)).astype(np.float64)


def organise(X: Float64Array, Y: Float64Array, d: Float64Array, edge_m: float, config: SomConfig) -> Float64Array:
    """The neurons (M, 3) [m] after all iterations over the cloud X (N, 3), N >= 1, from the nodes Y (M, 3).

    `edge_m` is the mean length of an edge at rest. The radius shrinks by a constant factor, and never exceeds
    the error of the map: in a tight coil a wide neighbourhood draws the nodes of one turn to the next, and would fold a
    map that is nearly right.
    """
    from dlokit.skills.observer.compiled import winners

    T = Y
    for widest in np.geomspace(config.initial_radius, config.final_radius, config.iterations).tolist():
        winner, distance_m = winners(X, T)
        near = distance_m < config.gate_m + widest * edge_m
        if not near.any():
            break
        misfit = _quantile(distance_m[near], config.misfit_fraction) / edge_m
        radius = min(widest, max(misfit, config.final_radius))
        T = batch_update(X, T, neighbourhood(d, radius), winner, near)
    return T


def _quantile(values: Float64Array, fraction: float) -> float:
    """The value that this fraction of the values does not exceed."""
    last = round(fraction * (len(values) - 1))
    return float(np.partition(values, last)[last])


def carried(Y: Float64Array, T: Float64Array, shown: BoolArray, d: Float64Array, radius: float) -> Float64Array:
    """All nodes (M, 3) [m]: the `shown` (M,) ones from T, the hidden ones moved from Y like shown ones near them.

    Their displacement is the mean of the shown nodes', weighted by the neighbourhood.
    """
    exponent = d[:, shown] ** 2 / (-2.0 * radius**2)
    highest = np.max(exponent, axis=1, keepdims=True)
    reached = np.isfinite(highest[:, 0])  # False in a connected part without a shown node
    weight = np.exp(exponent[reached] - highest[reached])  # the nearest shown node has weight 1 at any distance
    nodes = Y.copy()
    nodes[reached] += weight / weight.sum(axis=1, keepdims=True) @ (T - Y)[shown]
    nodes[shown] = T[shown]
    return nodes


class Som:
    """The batch map as an observer: neurons start at the prior's nodes, on the DLO's own topology."""

    def __init__(self, config: SomConfig | None = None, radius_m: float = RADIUS_M) -> None:
        self._config, self._radius_m = config or SomConfig(), radius_m

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The prior's nodes, organised on the cloud. Health is the fraction of points near them."""
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        nodes, shown = self._organised(thinned(points, self._config.max_points), prior)
        found = targets_at(nodes, points, seen, prior.topology, self._radius_m)
        return msgspec.structs.replace(found, visible=shown & found.visible)

    def _organised(self, X: Float64Array, prior: DloState) -> tuple[Float64Array, BoolArray]:
        """The nodes (M, 3) [m], and which of them were not hidden (M,).

        A map spreads over all points: where a part of the DLO is hidden, it draws the hidden nodes to the shown part.
        The shown nodes are then organised again without them.
        """
        Y = prior.nodes_world
        d = graph_distances(prior.topology, len(Y))
        edge_m = float(np.mean(prior.topology.rest_lengths_m))
        nodes = organise(X, Y, d, edge_m, self._config)
        won = points_won(X, Y, self._config.gate_m + self._config.initial_radius * edge_m)
        shown = won >= max(self._config.empty * float(np.median(won)), 1.0)
        if shown.all() or not shown.any() or not is_partial(nodes, prior.topology, self._config):
            return nodes, np.ones(len(Y), dtype=np.bool_)
        T = Y.copy()
        T[shown] = organise(X, Y[shown], d[np.ix_(shown, shown)], edge_m, self._config)
        return carried(Y, T, shown, d, self._config.initial_radius), shown


def is_partial(nodes: Float64Array, topology: Topology, config: SomConfig) -> bool:
    """Whether a map (M, 3) [m] is shrunk or torn, so that a part of the DLO must be hidden."""
    a, b = topology.edges[:, 0], topology.edges[:, 1]
    lengths = np.linalg.norm(nodes[a] - nodes[b], axis=1)
    rest = topology.rest_lengths_m
    torn = bool(np.any(lengths > config.torn * np.maximum(rest, rest.mean())))  # a short edge stretches easily
    return torn or float(lengths.sum()) < config.shrunk * float(rest.sum())
