"""Two cameras side by side: each one alone, and the rectified pair of two cameras that are not parallel.

Stereo matching compares rows, so it needs two parallel cameras with the same intrinsics, one shifted along the rows.
Two cameras on a bracket are never exactly parallel; their pictures are remapped to those of a parallel pair.
"""

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
import scipy

from dlokit import geometry
from dlokit.errors import BadValue
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.image import CameraCalibration, RawCamera
from dlokit.types.pose import Pose

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
        beside_m = (camera.baseline_m or 0.0) * geometry.rotation(rectified)[:, 0]
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
        T_world_camera=geometry.compose(rectified, geometry.pose((0.0, 0.0, 0.0), raw.wxyz)),
        baseline_m=None,
        distortion=raw.distortion,
        raw_left=None,
        raw_right=None,
    )


def turn_to_rectified(camera: CameraCalibration, side: Side) -> Float64Array:
    """The rotation (3, 3) from the frame of one camera to the rectified one; the identity for a parallel pair."""
    raw = (camera.raw_left, camera.raw_right)[side]
    return np.eye(3) if raw is None else geometry.rotation(geometry.pose((0.0, 0.0, 0.0), raw.wxyz))


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
