"""An observer that pulls the rod onto the cloud step by step and keeps its length.

In each step every point pulls the place of the rod that is nearest to it, less the farther it is (a Cauchy weight whose
scale shrinks from step to step); neighbours share the pull; then every edge is put back to its rest length, as in
position-based dynamics. Hidden nodes move as the visible ones beside them do.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import nothing_seen
from dlokit.skills.observer.visibility import explained_fraction, visible_nodes
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PulledConfig:
    """Settings of the observer that pulls the rod onto the cloud."""

    name: ClassVar[str] = "pulled"

    steps: int = 15
    """Steps from the prior to the targets."""
    first_scale_m: float = 0.04
    """Range of the pull in the first step [m]; choose the largest motion between two clouds."""
    last_scale_m: float = 0.005
    """Range of the pull in the last step [m]; choose twice the noise of the cloud."""
    stiffness: float = 1.0
    """Coupling of neighbouring nodes, in points of a cloud; 0 moves each node independently."""
    length_rounds: int = 10
    """Rounds of length correction per step."""
    max_points: int = 500
    """Approximate maximum number of points; larger clouds are thinned evenly over their index."""

    def __post_init__(self) -> None:
        if self.steps < 1 or not 0.0 < self.last_scale_m <= self.first_scale_m:
            raise ValueError("steps must be at least 1, and 0 < last_scale_m <= first_scale_m")

    def build(self, dlo: BelievedDlo) -> "Pulled":
        """Build the observer; the prior's topology contains all that it needs about the DLO."""
        return Pulled(self)


class Pulled:
    """Pulls the rod onto the cloud."""

    def __init__(self, config: PulledConfig) -> None:
        self._config = config

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """Target points in the order of the prior; health is the fraction of points on the rod."""
        config, topology = self._config, prior.topology
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        nodes = prior.nodes_world.copy()
        pulling = points[:: max(len(points) // config.max_points, 1)]
        joined = _laplacian(topology, len(nodes)) * config.stiffness * len(pulling) / len(nodes)
        for scale_m in np.geomspace(config.first_scale_m, config.last_scale_m, config.steps):
            weight, pull = _pulls(pulling, nodes, topology, float(scale_m))
            # A small weight for each node keeps a rod far from all points in place.
            nodes = nodes + np.linalg.solve(np.diag(weight + 1e-6) + joined, pull)
            nodes = _with_rest_lengths(nodes, topology, config.length_rounds)
        return TargetPoints(
            stamp_ns=seen.stamp_ns,
            nodes_world=nodes,
            visible=visible_nodes(nodes, points, seen),
            health=explained_fraction(points, nodes, topology),
        )


def _pulls(points: Array, nodes: Array, topology: Topology, scale_m: float) -> tuple[Array, Array]:
    """Sums over the points (N, 3) [m] for each node (M, 3) [m]: of weights (M,), and of weighted offsets (M, 3) [m]."""
    a, b = topology.edges[:, 0], topology.edges[:, 1]
    along = nodes[b] - nodes[a]  # (E, 3)
    t = np.einsum("nek,ek->ne", points[:, None] - nodes[a], along) / np.maximum(np.sum(along**2, axis=1), 1e-12)
    t = np.clip(t, 0.0, 1.0)
    offset = points[:, None] - nodes[a] - t[..., None] * along  # (N, E, 3)
    nearest = np.argmin(np.einsum("nek,nek->ne", offset, offset), axis=1)
    every = np.arange(len(points))
    offset, t = offset[every, nearest], t[every, nearest]
    w = (1.0 + np.sum(offset**2, axis=1) / scale_m**2) ** -2
    weight, pull = np.zeros(len(nodes)), np.zeros_like(nodes)
    for node, share in ((a[nearest], w * (1.0 - t)), (b[nearest], w * t)):
        np.add.at(weight, node, share)
        np.add.at(pull, node, share[:, None] * offset)
    return weight, pull


def _laplacian(topology: Topology, count: int) -> Array:
    """The graph Laplacian (M, M); it maps displacements to their differences from the neighbours' mean."""
    L = np.zeros((count, count))
    for i, j in topology.edges:
        L[[i, j], [i, j]] += 1.0
        L[[i, j], [j, i]] -= 1.0
    return L


def _with_rest_lengths(nodes: Array, topology: Topology, rounds: int) -> Array:
    """The nodes (M, 3) [m] with every edge closer to its rest length; both ends move equally."""
    a, b = topology.edges[:, 0], topology.edges[:, 1]
    degree = np.bincount(topology.edges.reshape(-1), minlength=len(nodes))[:, None]
    for _ in range(rounds):
        along = nodes[b] - nodes[a]
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-12)
        shift = (0.5 * (1.0 - topology.rest_lengths_m / length))[:, None] * along
        moved = np.zeros_like(nodes)
        np.add.at(moved, a, shift)
        np.add.at(moved, b, -shift)
        nodes = nodes + moved / degree
    return nodes
