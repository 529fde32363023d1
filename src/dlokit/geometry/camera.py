"""Pinhole camera: projection and back-projection. Camera frame: x right, y down, z forward."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import BadValue, ConfigError
from dlokit.geometry import rotation
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose


@dataclass(frozen=True, kw_only=True)
class Projection:
    """World points projected into the image."""

    pixels: Float64Array  # (N, 2) u, v [px]
    depth_m: Float64Array  # (N,) along z of the camera [m]; not positive behind the camera


def camera_matrix(fx_px: float, fy_px: float, cx_px: float, cy_px: float) -> Float64Array:
    """The camera matrix K (3, 3) [px]."""
    return np.array([[fx_px, 0.0, cx_px], [0.0, fy_px, cy_px], [0.0, 0.0, 1.0]])


def centred_camera(width_px: int, height_px: int, focal_px: float, T_world_camera: Pose) -> CameraCalibration:
    """A camera without distortion, with one focal length [px] and its principal point at the centre of the pictures."""
    return CameraCalibration(
        width_px=width_px,
        height_px=height_px,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width_px - 1) / 2.0,
        cy_px=(height_px - 1) / 2.0,
        T_world_camera=T_world_camera,
    )


def intrinsics(K: Float64Array) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy [px] of a camera matrix (3, 3); the inverse of `camera_matrix`.

    Raises `BadValue` where the matrix is transposed, scaled or skewed.
    """
    fx, fy, cx, cy = float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])
    if not np.allclose(K, camera_matrix(fx, fy, cx, cy), rtol=0.0, atol=1e-6):
        raise BadValue(
            f"a camera matrix is {K.tolist()}; it must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, without skew"
        )
    return fx, fy, cx, cy


def in_camera(points_world: ArrayLike, camera: CameraCalibration) -> Float64Array:
    """World points (N, 3) [m] in the camera frame, where z is the depth."""
    offsets = np.asarray(points_world, dtype=np.float64) - camera.T_world_camera.position_m
    return offsets @ rotation(camera.T_world_camera)


def project(points_world: ArrayLike, camera: CameraCalibration) -> Projection:
    """Project world points (N, 3) [m] into the (rectified left) image of `camera`."""
    p_camera = in_camera(points_world, camera)
    depth = p_camera[:, 2]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    u = camera.fx_px * p_camera[:, 0] / safe + camera.cx_px
    v = camera.fy_px * p_camera[:, 1] / safe + camera.cy_px
    return Projection(pixels=np.column_stack([u, v]), depth_m=depth)


def rays(pixels: ArrayLike, camera: CameraCalibration) -> Float64Array:
    """Directions (N, 3) in the camera frame through pixels (N, 2), scaled to z = 1."""
    uv = np.asarray(pixels, dtype=np.float64)
    return np.column_stack(
        [(uv[:, 0] - camera.cx_px) / camera.fx_px, (uv[:, 1] - camera.cy_px) / camera.fy_px, np.ones(len(uv))]
    )


def back_project(pixels: ArrayLike, depth_m: ArrayLike, camera: CameraCalibration) -> Float64Array:
    """World points (N, 3) [m] of pixels (N, 2) with depth (N,) [m]; the inverse of `project`."""
    p_camera = rays(pixels, camera) * np.asarray(depth_m, dtype=np.float64)[:, None]
    return p_camera @ rotation(camera.T_world_camera).T + camera.T_world_camera.position_m


def baseline_m(camera: CameraCalibration) -> float:
    """Distance between the two cameras [m]. Raises `ConfigError` for a single camera."""
    if camera.baseline_m is None or camera.baseline_m <= 0.0:
        raise ConfigError(
            f"the calibration of camera {camera.serial!r} has baseline {camera.baseline_m}, so it is not a stereo "
            "pair; stereo matching needs a baseline above 0 m: use a stereo camera or set baseline_m in the calibration"
        )
    return camera.baseline_m


@dataclass(frozen=True, kw_only=True)
class PlaneDisparity:
    """Disparity of a plane as an affine function of the pixel: ``d = per_u * u + per_v * v + constant`` [px]."""

    per_u: float
    per_v: float
    constant: float

    def at(self, u: Float64Array, v: Float64Array) -> Float64Array:
        """Disparity [px] at columns `u` and rows `v`."""
        return self.per_u * u + self.per_v * v + self.constant


def plane_disparity(camera: CameraCalibration, height_m: float) -> PlaneDisparity:
    """Disparity of the horizontal plane at `height_m` in the world, from ``d = f B / Z``.

    Let n be the world's z axis in the camera frame and h the camera's height above the plane. A point p of the plane
    satisfies ``n · p = -h``; with ``p = Z r(u, v)`` this gives ``1 / Z = n · r(u, v) / -h``.
    """
    n = rotation(camera.T_world_camera)[2]
    h = float(camera.T_world_camera.position_m[2]) - height_m
    if h <= 0.0:
        raise ConfigError(
            f"the calibrated camera is {h:.3f} m above the plane at {height_m:.3f} m; it must be above the plane: "
            "check T_world_camera in its calibration"
        )
    scale = -camera.fx_px * baseline_m(camera) / h
    per_u, per_v = scale * n[0] / camera.fx_px, scale * n[1] / camera.fy_px
    return PlaneDisparity(per_u=per_u, per_v=per_v, constant=scale * n[2] - per_u * camera.cx_px - per_v * camera.cy_px)
