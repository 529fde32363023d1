"""Nodes that the camera cannot see: out of the picture, behind the robot, or behind the DLO itself."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dlokit.geometry import rotation
from dlokit.geometry.camera import in_camera
from dlokit.skills.observer.visibility import PICTURE_MARGIN_PX, ROBOT_MARGIN_M
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Observation


def behind_itself(nodes_world: Float64Array, radius_m: float, calibration: CameraCalibration | None) -> BoolArray:
    """Whether another part of a chain hides each node (M, 3) [m] from the camera, (M,).

    A node is hidden when its middle is in the picture of a piece between two other nodes (a strip as wide as the rod of
    `radius_m` [m]) and farther away by at least three quarters of a diameter: touching parts are a diameter apart, and
    nodes are estimates. Without a calibration no node is known to be hidden.
    """
    if calibration is None or len(nodes_world) < 4:
        return np.zeros(len(nodes_world), dtype=np.bool_)
    return behind_in_camera(in_camera(nodes_world, calibration), radius_m)


@njit(cache=True)
def behind_in_camera(p_camera: Float64Array, radius_m: float) -> BoolArray:
    """`behind_itself` for nodes (M, 3) [m] in the camera's frame, in its picture u = x / z, v = y / z."""
    count = len(p_camera)
    hidden = np.zeros(count, dtype=np.bool_)
    z = p_camera[:, 2]
    before_camera = z > 1e-6
    depth = np.where(before_camera, z, 1.0)
    u, v = p_camera[:, 0] / depth, p_camera[:, 1] / depth
    for node in range(count):
        if not before_camera[node]:
            continue
        for piece in range(count - 1):
            if piece in (node - 1, node) or not (before_camera[piece] and before_camera[piece + 1]):
                continue
            du, dv = u[piece + 1] - u[piece], v[piece + 1] - v[piece]
            square = max(du * du + dv * dv, 1e-18)
            fraction = ((u[node] - u[piece]) * du + (v[node] - v[piece]) * dv) / square
            fraction = min(max(fraction, 0.0), 1.0)
            # Along a straight piece 1 / z runs linearly in the picture.
            nearer = 1.0 / ((1.0 - fraction) / z[piece] + fraction / z[piece + 1])
            off_u, off_v = u[node] - u[piece] - fraction * du, v[node] - v[piece] - fraction * dv
            if (off_u * off_u + off_v * off_v) * nearer * nearer > radius_m * radius_m:
                continue
            if z[node] - nearer > 1.5 * radius_m:
                hidden[node] = True
                break
    return hidden


_NO_ROBOT = np.full((1, 1), np.inf, dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class View:
    """The camera of one cloud; positions about the problem's origin."""

    R_world_camera: Float64Array
    """(3, 3)."""
    eye: Float64Array
    """(3,) [m]."""
    pinhole: Float64Array
    """(6,): fx, fy, cx, cy, width, height [px]."""
    depth_m: Float32Array
    """(rows, columns) depth of the robot [m]; inf in cells without the robot."""
    scale: int
    """Pixels per cell of `depth_m`."""
    occlusion_known: bool
    """Whether the depth of the robot is known."""

    def shaded(self, positions: Float64Array) -> BoolArray:
        """Whether each position (K, 3) [m] is out of the picture or behind the robot, (K,)."""
        return _shaded(positions, self.R_world_camera, self.eye, self.pinhole, self.depth_m, self.scale)

    def behind_itself(self, nodes: Float64Array, radius_m: float) -> BoolArray:
        """Whether another part of the chain hides each node (M, 3) [m], (M,)."""
        return behind_in_camera((nodes - self.eye) @ self.R_world_camera, radius_m)

    def nearest_shade(self, position: Float64Array, reach_m: float) -> Float64Array | None:
        """The nearest place (3,) [m] at the same depth that the robot hides; None if there is none within `reach_m`."""
        found = _nearest_shade(position, self.R_world_camera, self.eye, self.pinhole, self.depth_m, self.scale, reach_m)
        return found if np.isfinite(found[0]) else None


def view_of(seen: Observation, origin: Float64Array) -> View | None:
    """The view of a cloud from `origin` (3,) [m] in the world; None if the camera is unknown."""
    camera = seen.calibration
    if camera is None:
        return None
    size = (camera.width_px, camera.height_px)
    return View(
        R_world_camera=rotation(camera.T_world_camera),
        eye=np.asarray(camera.T_world_camera.position_m, dtype=np.float64) - origin,
        pinhole=np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *size]),
        depth_m=_NO_ROBOT if seen.occlusion is None else np.array(seen.occlusion.depth_m, dtype=np.float32),
        scale=1 if seen.occlusion is None else seen.occlusion.scale,
        occlusion_known=seen.occlusion is not None,
    )


@njit(cache=True)
def _shaded(
    positions: Float64Array,
    R: Float64Array,
    eye: Float64Array,
    pinhole: Float64Array,
    depth_m: Float32Array,
    scale: int,
) -> BoolArray:
    fx, fy, cx, cy, width, height = pinhole
    margin_px = PICTURE_MARGIN_PX
    rows, columns = depth_m.shape
    hidden = np.zeros(positions.shape[0], dtype=np.bool_)
    for k in range(positions.shape[0]):
        a, b, c = positions[k, 0] - eye[0], positions[k, 1] - eye[1], positions[k, 2] - eye[2]
        x = R[0, 0] * a + R[1, 0] * b + R[2, 0] * c
        y = R[0, 1] * a + R[1, 1] * b + R[2, 1] * c
        z = R[0, 2] * a + R[1, 2] * b + R[2, 2] * c
        if z <= 1e-9:
            hidden[k] = True
            continue
        u, v = fx * x / z + cx, fy * y / z + cy
        if u < margin_px or u > width - 1.0 - margin_px or v < margin_px or v > height - 1.0 - margin_px:
            hidden[k] = True
            continue
        # Neighbouring cells count as well: the robot's edge may be anywhere within a cell.
        row, column = min(max(int(v / scale), 0), rows - 1), min(max(int(u / scale), 0), columns - 1)
        nearest = np.inf
        for i in range(max(row - 1, 0), min(row + 2, rows)):
            for j in range(max(column - 1, 0), min(column + 2, columns)):
                nearest = min(nearest, depth_m[i, j])
        hidden[k] = nearest < z - ROBOT_MARGIN_M
    return hidden


@njit(cache=True)
def _nearest_shade(
    position: Float64Array,
    R: Float64Array,
    eye: Float64Array,
    pinhole: Float64Array,
    depth_m: Float32Array,
    scale: int,
    reach_m: float,
) -> Float64Array:
    fx, fy, cx, cy, _, _ = pinhole
    rows, columns = depth_m.shape
    place = np.full(3, np.nan)
    p = R.T @ (position - eye)
    if p[2] <= 1e-9:
        return place
    u, v = fx * p[0] / p[2] + cx, fy * p[1] / p[2] + cy
    span = int(reach_m * fx / p[2] / scale) + 1
    row, column = int(v / scale), int(u / scale)
    best = reach_m**2
    for i in range(max(row - span, 0), min(row + span + 1, rows)):
        for j in range(max(column - span, 0), min(column + span + 1, columns)):
            if depth_m[i, j] >= p[2] - ROBOT_MARGIN_M:
                continue
            across = ((j + 0.5) * scale - u) * p[2] / fx
            down = ((i + 0.5) * scale - v) * p[2] / fy
            d2 = across * across + down * down
            if d2 < best:
                best = d2
                place = position + R @ np.array([across, down, 0.0])
    return place
