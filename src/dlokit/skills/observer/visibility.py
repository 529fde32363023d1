"""Visible nodes of a cloud (in the picture, not behind the robot, with points around them), and hidden nodes."""

import numpy as np
import scipy

from dlokit.geometry.camera import project
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation, Occlusion

SEEN_SIGMA_M = 0.005
"""Standard deviation of a seen node if the observer states no covariance [m]; the contract test requires it."""
WIDEST_M = 0.5
"""Largest standard deviation of a node [m]: the node is somewhere on the table."""


RADIUS_M = 0.004
"""Radius of the DLO to which the lengths of the observers refer [m]; see `thickness`."""
SUPPORT_RADIUS_M = 0.015
"""Points nearer than this support a node [m]; about a node spacing."""
LEAST_SUPPORT = 3
"""A node with fewer supporting points is hidden."""
ROBOT_MARGIN_M = 0.01
"""The robot hides points at least this far behind its surface [m]: more than the error of its pose."""
PICTURE_MARGIN_PX = 3.0
"""A node nearer to the border of the picture than this is out of view [px]."""


def thickness(radius_m: float) -> float:
    """The factor by which the observers' lengths grow for a DLO of `radius_m` [m].

    For a thinner DLO it is 1: its points spread by the camera's noise and the cubes of the cloud, not by the radius.
    """
    return max(radius_m / RADIUS_M, 1.0)


def grown_covariance(prior: DloState, seconds: float, speed_m_s: float) -> Float64Array:
    """Covariance (M, 3, 3) [m²] of the prior's nodes that were not seen for `seconds`.

    A node's standard deviation grows by `speed_m_s` per second in all directions, for any division of the time.
    """
    count = len(prior.nodes_world)
    before = prior.covariance
    if before is None or before.shape != (count, 3, 3):
        before = np.broadcast_to(np.eye(3) * SEEN_SIGMA_M**2, (count, 3, 3))
    sigma_m = np.sqrt(np.maximum(np.trace(before, axis1=1, axis2=2) / 3.0, 0.0))
    grown_m = np.maximum(np.minimum(sigma_m + speed_m_s * max(seconds, 0.0), WIDEST_M), sigma_m)
    return before + (grown_m**2 - sigma_m**2)[:, None, None] * np.eye(3)


def kept(stamp_ns: int, prior: DloState, speed_m_s: float) -> TargetPoints:
    """The prior's nodes as hidden targets with health 0; the covariance grows with the time since they were seen."""
    seconds = (stamp_ns - prior.observed_stamp_ns) / 1e9 if prior.observed_stamp_ns > 0 else 0.0
    return TargetPoints(
        stamp_ns=max(stamp_ns, prior.observed_stamp_ns),
        nodes_world=prior.nodes_world.copy(),
        visible=np.zeros(len(prior.nodes_world), dtype=np.bool_),
        covariance=grown_covariance(prior, seconds, speed_m_s),
        health=0.0,
        memory=prior.memory,
    )


def targets_at(
    nodes_world: Float64Array, points_world: Float64Array, seen: Observation, topology: Topology, radius_m: float
) -> TargetPoints:
    """Nodes (M, 3) [m] that were fitted to the cloud (N, 3) [m], N >= 1, as targets.

    Seen nodes are visible; health is the fraction of points near the nodes.
    """
    return TargetPoints(
        stamp_ns=seen.stamp_ns,
        nodes_world=nodes_world,
        visible=visible_nodes(nodes_world, points_world, seen, radius_m),
        health=explained_fraction(points_world, nodes_world, topology, radius_m),
    )


def visible_nodes(
    nodes_world: Float64Array, points_world: Float64Array, seen: Observation, radius_m: float = RADIUS_M
) -> BoolArray:
    """Whether each node (M, 3) [m] of a DLO of `radius_m` [m] was seen in the cloud (N, 3) [m], (M,)."""
    return supported(nodes_world, points_world, SUPPORT_RADIUS_M * thickness(radius_m)) & ~shaded(nodes_world, seen)


def supported(nodes_world: Float64Array, points_world: Float64Array, radius_m: float = SUPPORT_RADIUS_M) -> BoolArray:
    """Whether enough points are within `radius_m` [m] of each node, (M,)."""
    if len(points_world) == 0:
        return np.zeros(len(nodes_world), dtype=np.bool_)
    counts = scipy.spatial.KDTree(points_world).query_ball_point(nodes_world, radius_m, return_length=True)
    return np.asarray(counts) >= LEAST_SUPPORT


def distance_to_dlo_m(points_world: Float64Array, nodes_world: Float64Array, topology: Topology) -> Float64Array:
    """Distance of each point (N, 3) [m] to the nearest edge between nodes (M, 3) [m], (N,).

    The error along an edge is at most a sixteenth of the edge.
    """
    a, b = nodes_world[topology.edges[:, 0]], nodes_world[topology.edges[:, 1]]
    steps = np.linspace(0.0, 1.0, 9)[:, None, None]
    distance, _ = scipy.spatial.KDTree((a + steps * (b - a)).reshape(-1, 3)).query(points_world)
    return np.asarray(distance, dtype=np.float64)


def explained_fraction(
    points_world: Float64Array, nodes_world: Float64Array, topology: Topology, radius_m: float = RADIUS_M
) -> float:
    """The fraction of the points (N, 3) [m], N >= 1, within the support radius of a DLO of `radius_m` [m].

    A mixture's own inlier probabilities are not a measure of fit: its variance grows until they fit.
    """
    support_m = SUPPORT_RADIUS_M * thickness(radius_m)
    return float(np.mean(distance_to_dlo_m(points_world, nodes_world, topology) < support_m))


def shaded(positions_world: Float64Array, seen: Observation) -> BoolArray:
    """Whether each position (K, 3) [m] is out of the picture or behind the robot, (K,).

    Without a calibration no position is known to be hidden.
    """
    if seen.calibration is None:
        return np.zeros(len(positions_world), dtype=np.bool_)
    projection = project(positions_world, seen.calibration)
    pixels, depth_m = projection.pixels, projection.depth_m
    margin = PICTURE_MARGIN_PX
    size = np.array([seen.calibration.width_px, seen.calibration.height_px])
    outside = (depth_m <= 0.0) | np.any((pixels < margin) | (pixels > size - 1 - margin), axis=1)
    if seen.occlusion is None:
        return outside
    return outside | (_robot_depth(pixels, seen.occlusion) < depth_m - ROBOT_MARGIN_M)


def _robot_depth(pixels: Float64Array, occlusion: Occlusion) -> Float64Array:
    """The robot's depth (K,) [m] at pixels (K, 2); inf at pixels without the robot.

    Neighbouring cells count as well: the robot's edge may be anywhere within a cell.
    """
    rows, columns = occlusion.depth_m.shape
    column = np.clip((pixels[:, 0] / occlusion.scale).astype(np.int64), 0, columns - 1)
    row = np.clip((pixels[:, 1] / occlusion.scale).astype(np.int64), 0, rows - 1)
    around = np.arange(-1, 2)
    near_row = np.clip(row[:, None] + around, 0, rows - 1)
    near_column = np.clip(column[:, None] + around, 0, columns - 1)
    return occlusion.depth_m[near_row[:, :, None], near_column[:, None, :]].min(axis=(1, 2)).astype(np.float64)
