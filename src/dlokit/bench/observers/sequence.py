"""A moving DLO whose nodes are known at every frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.bench.observers.centre_line import lengths_between_m
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import Topology
from dlokit.types.pose import Pose


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """Ground truth: T frames of K nodes, in the world frame. The first frame is where observers start from."""

    name: str
    rate_hz: float
    nodes_world: Float64Array  # (T, K, 3) [m]
    radius_m: float
    """Radius of the DLO [m]: clouds show its surface."""
    pin_nodes: tuple[int, ...] = ()
    """Nodes that a gripper holds at some time, P of them."""
    pins_world: Float64Array | None = None  # (T, P, 3) [m] where grippers hold them; NaN while they do not
    T_world_camera: Pose | None = None
    """Where the camera stands; None where clouds come with the sequence and nobody knows."""
    clouds_world: NDArray[np.floating] | None = None  # (T, N, 3) [m], rows of NaN are padding; None: simulated

    @property
    def frames(self) -> int:
        """T."""
        return len(self.nodes_world)

    @property
    def count(self) -> int:
        """K."""
        return self.nodes_world.shape[1]

    @property
    def topology(self) -> Topology:
        """The rod's edges, each as long as the curve of the first frame is between its nodes."""
        first = np.arange(self.count - 1)
        return Topology(
            edges=np.column_stack([first, first + 1]).astype(np.int64),
            rest_lengths_m=lengths_between_m(self.nodes_world[0]),
        )
