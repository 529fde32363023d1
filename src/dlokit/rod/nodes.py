"""The configured rod's edges, and the resampling of a curve to its nodes and length."""

import numpy as np

from dlokit import geometry
from dlokit.rod.believed import BelievedDlo
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import Topology


def topology(config: BelievedDlo) -> Topology:
    """The rod's edges: a single line of equal segments."""
    return in_a_row(np.full(config.nodes - 1, config.length_m / (config.nodes - 1)))


def in_a_row(rest_lengths_m: Float64Array) -> Topology:
    """The edges of a rod whose nodes are joined one to the next, with these lengths (E,) [m] at rest."""
    first = np.arange(len(rest_lengths_m), dtype=np.int64)
    return Topology(edges=np.column_stack((first, first + 1)), rest_lengths_m=rest_lengths_m)


def fit_length(config: BelievedDlo, nodes_world: Float64Array) -> Float64Array:
    """A curve (K, 3) [m] as the rod's nodes (M, 3): its ends cut or prolonged equally to the rod's length."""
    s = geometry.arc_lengths(nodes_world)
    if len(nodes_world) == config.nodes and abs(s[-1] - config.length_m) < 0.005 * config.length_m:
        # Already a rod of this length. Resampling would cut its corners a little each time.
        return nodes_world.copy()
    excess = (s[-1] - config.length_m) / 2.0
    wanted = np.linspace(excess, s[-1] - excess, config.nodes)
    inside = np.clip(wanted, 0.0, s[-1])
    nodes = np.column_stack([np.interp(inside, s, nodes_world[:, axis]) for axis in range(3)])
    start, end = geometry.tangents(nodes_world)[[0, -1]]
    return nodes + np.outer(np.minimum(wanted, 0.0), start) + np.outer(np.maximum(wanted - s[-1], 0.0), end)
