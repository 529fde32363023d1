"""The paper's stereo rig: where it stands, and the points it measures of a rod."""

import numpy as np
from scipy.spatial.transform import Rotation

from dlokit.bench.observers.conditions import Conditions, depths_m
from dlokit.bench.observers.sequence import Sequence
from dlokit.description.scene import default_calibration
from dlokit.geometry import inverse, matrix, pose_from_matrix, tangents, transform
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

NOISE_DEPTH_M = 1.2
"""Depth at which the noise is what was asked for [m]: the table's middle. It grows with the depth's square."""
STRAY_MARGIN_M = 0.10
"""Outliers lie anywhere in the box around the DLO, so much wider on each side [m]."""
_BORDER_PX = 20.0  # room around the DLO in the picture


def camera_of(sequence: Sequence) -> CameraCalibration | None:
    """The rig's left camera where the sequence has it, its picture as large as the sequence needs."""
    if sequence.T_world_camera is None:
        return None
    return _seeing_all(sequence.nodes_world.reshape(-1, 3), sequence.T_world_camera)


def moved(camera: CameraCalibration, T_world_camera: Pose) -> CameraCalibration:
    """The same camera elsewhere."""
    return CameraCalibration(
        width_px=camera.width_px,
        height_px=camera.height_px,
        fx_px=camera.fx_px,
        fy_px=camera.fy_px,
        cx_px=camera.cx_px,
        cy_px=camera.cy_px,
        T_world_camera=T_world_camera,
        baseline_m=camera.baseline_m,
        serial=camera.serial,
    )


def believed_pose(T_world_camera: Pose, conditions: Conditions, rng: np.random.Generator) -> Pose:
    """Where a camera is believed to be: off by what hand-eye calibration errs, in random directions."""
    shift, axis = _unit(rng.normal(size=(2, 3)))
    T = matrix(T_world_camera)
    T[:3, :3] = Rotation.from_rotvec(conditions.camera_error_rad * axis).as_matrix() @ T[:3, :3]
    T[:3, 3] += conditions.camera_error_m * shift
    return pose_from_matrix(T)


def as_believed(points_world: Float64Array, T_true: Pose, T_believed: Pose) -> Float64Array:
    """Points (N, 3) [m] that a camera at `T_true` measured, where they seem to be from `T_believed`."""
    return transform(T_believed, transform(inverse(T_true), points_world))


def stereo_cloud(
    line_world: Float64Array,
    shown: BoolArray,
    radius_m: float,
    conditions: Conditions,
    camera: CameraCalibration,
    rng: np.random.Generator,
) -> Float64Array:
    """A cloud (N, 3) [m] of the `shown` (K,) parts of a centre line (K, 3) [m], in random order.

    Points lie on the side of the surface that faces the camera and are moved back by the radius, as perception
    does. The stereo rig errs in depth, so each is moved along its own view ray.
    """
    if not shown.any():
        return np.empty((0, 3))
    count = round(conditions.points * float(shown.mean()))
    strays = round(conditions.outliers * count)
    eye = camera.T_world_camera.position_m
    at = rng.choice(np.flatnonzero(shown), size=count - strays)
    centres = line_world[at]
    view = _unit(centres - eye)
    across = _unit(np.cross(tangents(line_world)[at], view))
    offset = rng.uniform(-radius_m, radius_m, size=(len(at), 1))
    surface = centres + across * offset + view * (radius_m - np.sqrt(radius_m**2 - offset**2))
    depth = depths_m(surface, camera)
    wrong = rng.normal(size=len(at)) * conditions.noise_m * (depth / NOISE_DEPTH_M) ** 2
    measured = eye + (surface - eye) * (1.0 + wrong / depth)[:, None]
    low, high = line_world.min(axis=0) - STRAY_MARGIN_M, line_world.max(axis=0) + STRAY_MARGIN_M
    return rng.permutation(np.concatenate([measured, rng.uniform(low, high, size=(strays, 3))]))


def _seeing_all(positions_world: Float64Array, T_world_camera: Pose) -> CameraCalibration:
    base = default_calibration()
    p = transform(inverse(T_world_camera), positions_world)
    reach = np.abs(p[:, :2] / p[:, 2:]).max(axis=0) * base.fx_px + _BORDER_PX
    width, height = max(base.width_px, 2 * int(reach[0]) + 1), max(base.height_px, 2 * int(reach[1]) + 1)
    return CameraCalibration(
        width_px=width,
        height_px=height,
        fx_px=base.fx_px,
        fy_px=base.fy_px,
        cx_px=(width - 1) / 2.0,
        cy_px=(height - 1) / 2.0,
        T_world_camera=T_world_camera,
        baseline_m=base.baseline_m,
        serial="bench",
    )


def _unit(vectors: Float64Array) -> Float64Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
