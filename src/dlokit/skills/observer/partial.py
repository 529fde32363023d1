"""Registration without the nodes that the cloud does not show, for DLOs of any topology."""

import msgspec
import numpy as np

from dlokit.skills.observer.cpd import CpdConfig, register
from dlokit.skills.observer.mixture import Registration, motion, thinned
from dlokit.skills.observer.visibility import SUPPORT_RADIUS_M, supported, targets_at, thickness
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation

SQUEEZED = 0.6  # a rod hardly shortens; a mixture whose branch is hidden folds it onto its neighbour


def register_visible(
    points: Float64Array,
    first: Registration,
    seen: Observation,
    prior: DloState,
    cpd: CpdConfig,
    radius_m: float,
) -> TargetPoints:
    """Target points of a DLO of which parts may be hidden, from a `first` registration of all its nodes.

    `points` (N, 3) [m] are the cloud's, in the world; `radius_m` [m] is the DLO's.

    A mixture draws the nodes of a hidden part to points of other parts. Nodes that had no points near them
    and ended in none, or with their edges squeezed or torn, are taken out; the others are registered again,
    and their coherent motion carries the hidden ones.
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
    """Which nodes (M,) the cloud (N, 3) [m] does not show, judged by where a registration put them (M, 3) [m]."""
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
