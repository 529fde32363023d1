"""A moving DLO whose nodes are known at every frame."""

from dataclasses import dataclass

from dlokit.types.arrays import Float64Array
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
    clouds_world: tuple[Float64Array, ...] | None = None  # T clouds (N, 3) [m]; None: they are simulated

    @property
    def frames(self) -> int:
        """T."""
        return len(self.nodes_world)

    @property
    def count(self) -> int:
        """K."""
        return self.nodes_world.shape[1]
