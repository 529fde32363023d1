"""Coherent point drift: the nodes are centroids of a Gaussian mixture that is fitted to the cloud.

Myronenko, Song: *Point Set Registration: Coherent Point Drift*, TPAMI 32 (2010), doi 10.1109/TPAMI.2010.46;
the non-rigid algorithm of its Fig. 4, with its symbols; the loop is in `mixture`. `register_visible` registers a DLO of
any topology when the cloud shows only a part of it.
"""

from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.mixture import MixtureConfig, Registration, Weights, fit_mixture, motion, thinned
from dlokit.skills.observer.visibility import RADIUS_M, SUPPORT_RADIUS_M, supported, targets_at, thickness
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class CpdConfig(MixtureConfig):
    """Coherent point drift, as in the paper: close to the curve, but nodes may slide along it."""

    name: ClassVar[str] = "cpd"

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """The strategy with these settings."""
        return Cpd(self, dlo.radius_m)


PLIABLE = CpdConfig(beta_m=0.12, lambda_per_m2=300.0, outlier_weight=0.05, initial_sigma_m=0.04, max_points=700)
"""A registration that follows every bend, for observers that correct nodes that slide along the curve."""


def register(X: Float64Array, Y: Float64Array, config: CpdConfig) -> Registration:
    """Move the nodes Y (M, 3) [m] onto the cloud X (N, 3) [m], N >= 1; the algorithm of Fig. 4.

    E-step eq. 6, M-step eq. 22: (d(P1) G + lambda sigma² I) W = P X - d(P1) Y; sigma² by eq. 23.
    """
    weights = Weights(lambda_per_m2=config.lambda_per_m2)
    return fit_mixture(X, Y, config, lambda iteration: weights)


class Cpd:
    """Coherent point drift as an observer: each cloud is registered from the prior's nodes."""

    def __init__(self, config: CpdConfig | None = None, radius_m: float = RADIUS_M) -> None:
        self._config, self._radius_m = config or CpdConfig(), radius_m

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The prior's nodes, drifted coherently onto the cloud. Health is the fraction of points near them."""
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        result = register(thinned(points, self._config.max_points), prior.nodes_world, self._config)
        return targets_at(result.nodes, points, seen, prior.topology, self._radius_m)


SQUEEZED = 0.6  # a rod hardly shortens; a mixture whose branch is hidden folds it onto its neighbour


def register_visible(
    points: Float64Array,
    first: Registration,
    seen: Observation,
    prior: DloState,
    cpd: CpdConfig,
    radius_m: float,
) -> TargetPoints:
    """Target points of a DLO with parts that may be hidden, from a `first` registration of all its nodes.

    `points` (N, 3) [m] are the cloud's, in the world; `radius_m` [m] is the DLO's.

    A mixture draws the nodes of a hidden part to points of other parts. A node counts as hidden when it had no points
    near it before, and after the registration has none or squeezed or torn edges. The other nodes are registered again,
    and their coherent motion moves the hidden ones.
    """
    hidden = hidden_nodes(points, first.nodes, prior, SUPPORT_RADIUS_M * thickness(radius_m))
    shown = ~hidden
    nodes = first.nodes
    if hidden.any() and np.count_nonzero(shown) >= 3:
        Y = prior.nodes_world
        result = register(thinned(points, cpd.max_points), Y[shown], cpd)
        nodes = Y + motion(Y, Y[shown], result, cpd.beta_m)
    found = targets_at(nodes, points, seen, prior.topology, radius_m)
    return msgspec.structs.replace(found, visible=shown & found.visible)


def hidden_nodes(points: Float64Array, drifted: Float64Array, prior: DloState, support_m: float) -> BoolArray:
    """Which nodes (M,) the cloud (N, 3) [m] does not show, by their registered positions `drifted` (M, 3) [m]."""
    alone_before = ~supported(prior.nodes_world, points, 1.5 * support_m)
    alone_after = ~supported(drifted, points, support_m)
    return alone_before & (alone_after | distorted_nodes(drifted, prior.topology))


def distorted_nodes(nodes: Float64Array, topology: Topology) -> BoolArray:
    """Which nodes (M,) have an edge much shorter or longer than at rest."""
    a, b = topology.edges[:, 0], topology.edges[:, 1]
    ratio = np.linalg.norm(nodes[a] - nodes[b], axis=1) / np.maximum(topology.rest_lengths_m, 1e-9)
    wrong = (ratio < SQUEEZED) | (ratio > 1.0 / SQUEEZED)
    flags = np.zeros(len(nodes), dtype=np.bool_)
    flags[topology.edges[wrong].ravel()] = True
    return flags
