"""Corrects the believed camera pose by the table, which is known to be flat and level.

A pair of pictures of a textured table, or its depths, give its plane in the camera frame. The plane determines three of
the pose's six numbers: two tilts and the height, but not the shift along the table or the turn about the vertical.
"""

import cv2
import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit.description.table import TABLE_TOP_M
from dlokit.geometry import rotation
from dlokit.geometry.camera import PlaneDisparity, baseline_m, plane_disparity
from dlokit.skills.perception.config import BoxConfig
from dlokit.skills.perception.rectification import grey
from dlokit.skills.perception.self_filter import box_outline
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, StereoImages
from dlokit.types.pose import Pose

_BLUR_PX = 1.5
"""Standard deviation of the blur before the alignment [px]: wider than the disparities to be corrected."""
_ITERATIONS = 6
_STRIDE = 5
"""Use one in this many pixels, which is enough for three parameters."""
_LEAST_PIXELS = 1000
_LARGEST_ANGLE_RAD = 0.02
"""A larger correction is rejected [rad]; the pose then stays as calibrated."""
_LARGEST_HEIGHT_M = 0.03
"""A larger correction of the camera's height is rejected [m]."""
_LEAST_AGREEING = 0.5
"""Fraction of the table's pixels that must agree in both pictures, or with the plane of the depths."""
_INVERSE_STEP_1_M = 0.001
"""Inverse depths that differ by less than this agree [1/m]: a step of 1 mm at a depth of 1 m."""
_LEAST_TEXTURE = 2.0
"""Standard deviation of the table's brightness, 0 to 255, below which it has too little texture."""


def camera_pose_from_table(images: CameraPictures, hidden: BoolArray, box: BoxConfig) -> Pose | None:
    """The corrected T_world_camera of rectified pictures; None when no plane near the believed one is found.

    `hidden` (height, width) are pixels that do not show the table: the DLO's and the robot's. The table is
    at the bottom of the box.
    """
    camera = images.calibration
    footprint = BoxConfig(
        lower_world=(box.lower_world[0], box.lower_world[1], TABLE_TOP_M - 0.001),
        upper_world=(box.upper_world[0], box.upper_world[1], TABLE_TOP_M + 0.001),
    )
    shown = box_outline(footprint, camera) & ~hidden
    if isinstance(images, StereoImages):
        plane = _aligned(grey(images.left), grey(images.right), shown, plane_disparity(camera, TABLE_TOP_M))
    else:
        # The disparities of this camera are inverse depths [1/m], in which a plane is affine as well.
        camera = msgspec.structs.replace(camera, baseline_m=1.0 / camera.fx_px)
        plane = _fitted(images.depth_m, shown, plane_disparity(camera, TABLE_TOP_M))
    return None if plane is None else _corrected(camera, plane)


def _fitted(depth_m: Float32Array, shown: BoolArray, believed: PlaneDisparity) -> PlaneDisparity | None:
    """The plane of inverse depths [1/m] in most of the shown pixels, by least squares without outliers.

    Disparities of a depth camera err by the same amount everywhere, so that inverse depths need no weights.
    """
    rows, columns = (indices[::_STRIDE] for indices in np.nonzero(shown & (depth_m > 0.0)))
    if len(rows) < _LEAST_PIXELS:
        return None
    u, v = columns.astype(np.float64), rows.astype(np.float64)
    inverse = 1.0 / depth_m[rows, columns].astype(np.float64)
    J = np.column_stack([u, v, np.ones(len(u))])  # (K, 3) change of the inverse depth by the parameters
    p: Float64Array = np.array([believed.per_u, believed.per_v, believed.constant])
    agreeing = 0
    for _ in range(_ITERATIONS):
        residual = inverse - J @ p
        off = np.abs(residual - np.median(residual))
        good = off <= 3.0 * max(float(np.median(off)), _INVERSE_STEP_1_M)
        H, g = np.einsum("ki,kj->ij", J[good], J[good]), np.einsum("ki,k->i", J[good], residual[good])
        p += np.linalg.lstsq(H, g, rcond=None)[0]
        agreeing = np.count_nonzero(good)
    if agreeing < _LEAST_AGREEING * len(u):
        return None
    return PlaneDisparity(per_u=float(p[0]), per_v=float(p[1]), constant=float(p[2]))


def _aligned(left: UInt8Array, right: UInt8Array, shown: BoolArray, believed: PlaneDisparity) -> PlaneDisparity | None:
    """The plane whose shear brings the right picture onto the left one, from the believed one.

    Lucas and Kanade's method with three parameters: least squares of the difference of the pictures, which is
    finer than matching pixel by pixel, whose disparities lean towards whole pixels.
    """
    rows, columns = (indices[::_STRIDE] for indices in np.nonzero(shown))
    u, v = columns.astype(np.float64), rows.astype(np.float64)
    J_plane = np.column_stack([u, v, np.ones(len(u))])  # (K, 3) change of the disparity by the parameters
    wanted = cv2.GaussianBlur(left, (0, 0), _BLUR_PX)[rows, columns].astype(np.float64)
    blurred = np.asarray(cv2.GaussianBlur(right, (0, 0), _BLUR_PX), dtype=np.float32)
    slope = np.asarray(cv2.Sobel(blurred, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8), dtype=np.float32)
    p: Float64Array = np.array([believed.per_u, believed.per_v, believed.constant])
    agreeing = 0
    for _ in range(_ITERATIONS):
        at_u = u - (p[0] * u + p[1] * v + p[2])
        known = (at_u >= 0.0) & (at_u <= right.shape[1] - 1)
        if np.count_nonzero(known) < _LEAST_PIXELS:
            return None
        residual = _sheared(blurred, p)[rows, columns] - wanted
        residual -= np.median(residual[known])  # the two cameras may differ in brightness
        good = known & (np.abs(residual) <= 3.0 * max(float(np.median(np.abs(residual[known]))), 1.0))
        J = -_sheared(slope, p)[rows[good], columns[good], None] * J_plane[good]
        # einsum stays on this thread; a large matrix product would wake the pool of BLAS for a few sums.
        H, g = np.einsum("ki,kj->ij", J, J), np.einsum("ki,k->i", J, residual[good])
        p -= np.linalg.lstsq(H, g, rcond=None)[0]
        agreeing = np.count_nonzero(good)
    if agreeing < _LEAST_AGREEING * len(u) or float(np.std(wanted)) < _LEAST_TEXTURE:
        return None
    return PlaneDisparity(per_u=float(p[0]), per_v=float(p[1]), constant=float(p[2]))


def _sheared(picture: Float32Array, p: Float64Array) -> Float32Array:
    """The right picture with each pixel moved by the disparity of the plane `p`, (height, width)."""
    shear = np.array([[1.0 - p[0], -p[1], -p[2]], [0.0, 1.0, 0.0]])
    size = (picture.shape[1], picture.shape[0])
    return np.asarray(
        cv2.warpAffine(picture, shear, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP), dtype=np.float32
    )


def _corrected(camera: CameraCalibration, plane: PlaneDisparity) -> Pose | None:
    """The believed pose, turned and lifted as little as possible so that the plane is level and at its height."""
    fB = camera.fx_px * baseline_m(camera)
    # 1 / Z = n · r / -h, with r = ((u - cx) / fx, (v - cy) / fy, 1); so -n / h can be read off the coefficients.
    center = plane.per_u * camera.cx_px + plane.per_v * camera.cy_px + plane.constant
    toward = -np.array([plane.per_u * camera.fx_px, plane.per_v * camera.fy_px, center]) / fB
    height_m = 1.0 / float(np.linalg.norm(toward))
    normal_camera = toward * height_m
    R = rotation(camera.T_world_camera)
    turn = Rotation.align_vectors(R[2][None, :], normal_camera[None, :])[0]
    lift = height_m + TABLE_TOP_M - float(camera.T_world_camera.position_m[2])
    if turn.magnitude() > _LARGEST_ANGLE_RAD or abs(lift) > _LARGEST_HEIGHT_M:
        return None
    position = camera.T_world_camera.position_m + np.array([0.0, 0.0, lift])
    wxyz = Rotation.from_matrix(R @ turn.as_matrix()).as_quat(scalar_first=True, canonical=True)
    return Pose(position_m=position, wxyz=wxyz)
