"""What is between the fingers, and how it follows the tool."""

from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.pose import Pose


@dataclass(frozen=True)
class Grip:
    """A held node with its neighbours, through which the pads hold the tangent too."""

    node: int
    nodes: Int64Array  # (n,) the node and its neighbours
    offsets_tcp: Float64Array  # (n, 3) [m] where they are in the tool's frame

    def targets_world(self, T_world_tcp: Pose) -> Float64Array:
        """Where the nodes are (n, 3) [m] when the tool is at `T_world_tcp`."""
        return geometry.transform(T_world_tcp, self.offsets_tcp)

    def gains_n_m(self, stiffness_n_m: float) -> Float64Array:
        """Spring gains (n, 1) [N/m]: the tangent is held less firmly than the point."""
        return np.where(self.nodes == self.node, 1.0, 0.25)[:, None] * stiffness_n_m


def take_hold(nodes_world: Float64Array, node: int, T_world_tcp: Pose) -> Grip:
    """The grip of a tool on `node` of a rod (M, 3) [m]; closing fingers bring the rod to the middle between them."""
    held = np.arange(max(node - 1, 0), min(node + 2, len(nodes_world)))
    offsets = geometry.transform(geometry.inverse(T_world_tcp), nodes_world[held])
    offsets[:, 1] -= offsets[held == node, 1]
    return Grip(node=node, nodes=held, offsets_tcp=offsets)
