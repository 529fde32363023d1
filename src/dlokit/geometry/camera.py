"""Pinhole cameras: projection and back-projection, and pairs of cameras. Camera frame: x right, y down, z forward.

Stereo matching compares rows, so it needs two parallel cameras with the same intrinsics, one shifted along the rows.
Two cameras on a bracket are never exactly parallel; their pictures are remapped to those of a parallel pair.
"""

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlokit.errors import BadValue, ConfigError
from dlokit.geometry import compose, pose, rotation
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.image import CameraCalibration, RawCamera
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


Side = Literal[0, 1]
"""0: the left camera of a pair, or a single camera; 1: the right one."""
SIDES: tuple[Side, Side] = (0, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class SeparateCamera:
    """A camera calibrated alone."""

    K: Float64Array  # (3, 3) camera matrix [px]
    distortion: Float32Array  # (5,) k1 k2 p1 p2 k3


def camera_alone(camera: CameraCalibration, side: Side) -> CameraCalibration:
    """One camera of a pair before rectification: its own pose, intrinsics and `distortion`, and no baseline."""
    rectified = camera.T_world_camera
    if side == 1:
        beside_m = (camera.baseline_m or 0.0) * rotation(rectified)[:, 0]
        rectified = Pose(position_m=rectified.position_m + beside_m, wxyz=rectified.wxyz)
    raw = (camera.raw_left, camera.raw_right)[side]
    if raw is None:
        return msgspec.structs.replace(
            camera,
            T_world_camera=rectified,
            baseline_m=None,
            distortion=(camera.distortion, camera.distortion_right)[side],
            distortion_right=None,
        )
    return msgspec.structs.replace(
        camera,
        fx_px=raw.fx_px,
        fy_px=raw.fy_px,
        cx_px=raw.cx_px,
        cy_px=raw.cy_px,
        T_world_camera=compose(rectified, pose((0.0, 0.0, 0.0), raw.wxyz)),
        baseline_m=None,
        distortion=raw.distortion,
        raw_left=None,
        raw_right=None,
    )


def turn_to_rectified(camera: CameraCalibration, side: Side) -> Float64Array:
    """The rotation (3, 3) from the frame of one camera to the rectified one; the identity for a parallel pair."""
    raw = (camera.raw_left, camera.raw_right)[side]
    return np.eye(3) if raw is None else rotation(pose((0.0, 0.0, 0.0), raw.wxyz))


def rectified_pair(
    camera: CameraCalibration, left: SeparateCamera, right: SeparateCamera, T_right_left: Float64Array
) -> CameraCalibration:
    """The rectified pair of two cameras whose size, serial and date `camera` gives; `T_right_left` (4, 4) [m].

    ``T_world_camera`` is unchanged: it is the pose of the rectified frame. Raises `BadValue` unless the second camera
    is on the right of the first one.
    """
    import cv2  # its import is slow, and many commands only read calibrations

    x, y, _ = (float(value) for value in T_right_left[:3, 3])
    if x >= -abs(y):
        raise BadValue(
            f"the right camera is {-1e3 * x:.0f} mm to the right of the left one and {-1e3 * y:.0f} mm below it; it "
            "must be on its right, and farther beside it than above or below: exchange the two, or turn the bracket"
        )
    size = (camera.width_px, camera.height_px)
    lenses = [one.distortion.astype(np.float64) for one in (left, right)]
    # The default scaling: the centres of both pictures stay in the centre, without cropping or shrinking.
    turn_left, turn_right, P_left, P_right, *_ = cv2.stereoRectify(
        left.K,
        lenses[0],
        right.K,
        lenses[1],
        size,
        T_right_left[:3, :3].copy(),
        T_right_left[:3, 3:].copy(),
        flags=cv2.STEREO_ZERO_DISPARITY,
        alpha=-1.0,
    )
    P, shift = np.asarray(P_left, dtype=np.float64), np.asarray(P_right, dtype=np.float64)
    raw = [
        RawCamera(
            fx_px=float(one.K[0, 0]),
            fy_px=float(one.K[1, 1]),
            cx_px=float(one.K[0, 2]),
            cy_px=float(one.K[1, 2]),
            wxyz=scipy.spatial.transform.Rotation.from_matrix(turn).as_quat(scalar_first=True, canonical=True),
            distortion=one.distortion,
        )
        for one, turn in ((left, turn_left), (right, turn_right))
    ]
    return msgspec.structs.replace(
        camera,
        fx_px=float(P[0, 0]),
        fy_px=float(P[1, 1]),
        cx_px=float(P[0, 2]),
        cy_px=float(P[1, 2]),
        baseline_m=float(-shift[0, 3] / shift[0, 0]),
        distortion=None,
        distortion_right=None,
        raw_left=raw[0],
        raw_right=raw[1],
    )
