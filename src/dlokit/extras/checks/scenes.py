"""The built-in clouds for checks of observers: a bow on a table, 0.5 m long, with 2 mm of noise."""

import msgspec
import numpy as np

from dlokit.geometry import pose, resample
from dlokit.geometry.camera import centred_camera
from dlokit.skills.observer.anchored import chain
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, Topology
from dlokit.types.observation import GripperPin, Observation, Occlusion

LENGTH_M = 0.5
NOISE_M = 0.002
SEEN_NS, BEFORE_NS = 77_000_000, 37_000_000
"""Stamps of the cloud and of the previous state."""


def rod(count: int, shift_m: float = 0.0) -> Float64Array:
    """A bow (count, 3) [m] on the table, moved sideways along x."""
    t = np.linspace(-1.0, 1.0, 200)
    bow = np.column_stack([0.5 - 0.05 * t**2, 0.24 * t, np.full(200, 0.004)])
    return resample(bow, count) + np.array([shift_m, 0.0, 0.0])


def cloud(shift_m: float = 0.0, count: int = 900, seed: int = 0) -> Observation:
    """Points of the bow, moved along x."""
    rng = np.random.default_rng(seed)
    points = resample(rod(400), max(count, 2))[:count] + rng.normal(0.0, NOISE_M, (count, 3))
    return observation(points + np.array([shift_m, 0.0, 0.0]))


def observation(points_world: Float64Array) -> Observation:
    """A cloud (N, 3) [m] as perception publishes it."""
    return Observation(stamp_ns=SEEN_NS, points_world=points_world.astype(np.float32))


def before(count: int, nodes_world: Float64Array | None = None) -> DloState:
    """The previous state: the bow before its motion, or other nodes (count, 3) [m] of the same rod."""
    nodes = rod(count) if nodes_world is None else nodes_world
    return DloState(stamp_ns=BEFORE_NS, nodes_world=nodes, topology=chain(count, LENGTH_M))


def clouds_in_motion(count: int) -> list[Observation]:
    """Clouds of the bow that moves by 5 mm from one to the next, the first after the motion, 40 ms apart."""
    return [
        msgspec.structs.replace(cloud(0.005 * number, seed=number), stamp_ns=BEFORE_NS + number * (SEEN_NS - BEFORE_NS))
        for number in range(1, count + 1)
    ]


def hidden_middle(shift_m: float) -> Observation:
    """The bow with 10 cm in its middle hidden."""
    seen = cloud(shift_m)
    return observation(seen.points_world[np.abs(seen.points_world[:, 1]) > 0.05].astype(np.float64))


def with_strays(seen: Observation) -> Observation:
    """The cloud, and a copy of every tenth point at a random place around it."""
    rng = np.random.default_rng(1)
    points = seen.points_world.astype(np.float64)
    low, high = points.min(axis=0) - 0.04, points.max(axis=0) + 0.04
    return observation(np.vstack([points, rng.uniform(low, high, (len(points) // 10, 3))]))


def in_view(seen: Observation, node: int) -> Observation:
    """The cloud with all optional data: the camera, the robot's occlusion, and a node in a gripper."""
    above = centred_camera(640, 480, 500.0, pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)))
    camera = msgspec.structs.replace(above, baseline_m=0.1)
    depth_m = np.full((60, 80), np.inf, dtype=np.float32)
    depth_m[:10, :10] = 0.8
    held = GripperPin(robot="robot", node=node, position_world=rod(31)[node].astype(np.float32))
    return Observation(
        stamp_ns=SEEN_NS,
        points_world=seen.points_world,
        calibration=camera,
        occlusion=Occlusion(depth_m=depth_m, scale=8),
        pins=(held,),
    )


def branched(shift_m: float) -> tuple[Observation, DloState, Float64Array]:
    """A bow with a branch at its middle: the cloud, the previous state, and its 40 present nodes (40, 3) [m]."""
    branch = np.column_stack([0.5 + np.linspace(0.02, 0.2, 9), np.zeros(9), np.full(9, 0.004)])
    nodes = np.vstack([rod(31), branch])
    edges = np.vstack([chain(31, LENGTH_M).edges, [[15, 31]], [[i, i + 1] for i in range(31, 39)]])
    lengths = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    state = DloState(stamp_ns=BEFORE_NS, nodes_world=nodes, topology=Topology(edges=edges, rest_lengths_m=lengths))
    dense = np.vstack([resample(rod(400), 700), resample(np.vstack([rod(31)[15], branch]), 280)])
    shift = np.array([shift_m, 0.0, 0.0])
    return observation(dense + np.random.default_rng(2).normal(0.0, NOISE_M, dense.shape) + shift), state, nodes + shift
