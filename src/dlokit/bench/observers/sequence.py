"""A moving DLO whose nodes are known at every frame, and the curve between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dlokit.geometry import arc_lengths
from dlokit.rod.believed import BelievedDlo
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.dlo import Topology
from dlokit.types.pose import Pose

FINE = 401
"""Points of a centre line."""
_A_SPAN = 32  # chords that the length of the curve between two nodes is summed over
_LEAST_STEP_M = 1e-6  # an estimate may have nodes that coincide; a spline's parameter must grow


@dataclass(frozen=True, kw_only=True)
class CentreLine:
    """A DLO as its cameras see it."""

    points_world: Float64Array  # (FINE, 3) [m], equally spaced along the arc
    nodes_at: Int64Array  # (K,) the index into `points_world` at each node


def centre_line(nodes_world: Float64Array) -> CentreLine:
    """The curve through nodes (K, 3) [m]."""
    curve, at = _curve(nodes_world)
    t = np.linspace(0.0, at[-1], FINE)
    s = arc_lengths(curve(t))
    points = np.asarray(curve(np.interp(np.linspace(0.0, s[-1], FINE), s, t)), dtype=np.float64)
    return CentreLine(
        points_world=points,
        nodes_at=np.rint(np.interp(at, t, s) / s[-1] * (FINE - 1)).astype(np.int64),
    )


def smooth_line(nodes_world: Float64Array, count: int) -> Float64Array:
    """About `count` points (N, 3) [m] of the curve through nodes (K, 3) [m]; every node is one of them."""
    each = max(1, round(count / (len(nodes_world) - 1)))
    if each == 1:
        return nodes_world
    curve, at = _curve(nodes_world)
    return np.asarray(curve(_divided(at, each)), dtype=np.float64)


def lengths_between_m(nodes_world: Float64Array) -> Float64Array:
    """Lengths (K-1,) [m] of the curve between neighbouring nodes (K, 3) [m]; chords are shorter where it bends."""
    curve, at = _curve(nodes_world)
    return np.diff(arc_lengths(curve(_divided(at, _A_SPAN)))[::_A_SPAN])


def _curve(nodes_world: Float64Array) -> tuple[CubicSpline, Float64Array]:
    steps = np.linalg.norm(np.diff(nodes_world, axis=0), axis=1)
    at = np.concatenate(([0.0], np.cumsum(np.maximum(steps, _LEAST_STEP_M))))
    return CubicSpline(at, nodes_world), at


def _divided(at: Float64Array, each: int) -> Float64Array:
    """Every span of the parameter (K,) in `each` parts, ((K-1) each + 1,)."""
    return np.interp(np.arange((len(at) - 1) * each + 1) / each, np.arange(len(at)), at)


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
    def dlo(self) -> BelievedDlo:
        """The DLO as a ruler tells."""
        length_m = float(self.topology.rest_lengths_m.sum())
        return BelievedDlo(nodes=self.count, length_m=length_m, radius_m=self.radius_m)

    @property
    def topology(self) -> Topology:
        """The rod's edges, each as long as the curve of the first frame is between its nodes."""
        first = np.arange(self.count - 1)
        return Topology(
            edges=np.column_stack([first, first + 1]).astype(np.int64),
            rest_lengths_m=lengths_between_m(self.nodes_world[0]),
        )
