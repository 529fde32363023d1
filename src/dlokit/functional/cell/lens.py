"""Optics of the cell's stereo camera beyond an ideal parallel pinhole pair: lenses, and two separate cameras.

The renderer produces pinhole pictures; this module distorts them like a lens.
"""

from functools import lru_cache

import cv2
import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit.geometry import homogeneous
from dlokit.geometry.camera import SeparateCamera, camera_matrix, rectified_pair
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration

_LEFT = (0.060, -0.050, 0.0006, -0.0004, 0.0)
_RIGHT = (0.052, -0.040, -0.0005, 0.0007, 0.0)
"""Coefficients k1 k2 p1 p2 k3: up to 7 px in the corners, towards the middle, so that every pixel has a source."""
SERIAL = "-lens"
"""Appended to the serial: a camera with lenses is another one."""
_SEPARATE_SERIAL = "-separate"
_FOCAL_FACTORS = (1.006, 0.991)
"""Focal lengths of the left and the right separate camera over the paper's: lenses of one kind differ by a percent."""
_CENTRE_OFF_PX = ((4.0, -6.0), (-7.0, 3.0))
"""Offset of each principal point from the picture's middle, columns and rows [px at 640 px width]."""
_RIGHT_TURN_DEG = (0.7, -3.0, 1.5)
"""Rotation vector from the right camera to the left one: tilted, toed in, rolled, as two cameras on a bracket are."""
_RIGHT_BESIDE_M = (0.102, 0.004, -0.003)
"""Centre of the right camera in the frame of the left one: 4 mm lower, and farther from the scene."""

Maps = tuple[Float32Array, Float32Array]


def with_lenses(camera: CameraCalibration) -> CameraCalibration:
    """The stereo camera with distorting lenses."""
    return msgspec.structs.replace(
        camera,
        distortion=np.array(_LEFT, dtype=np.float32),
        distortion_right=np.array(_RIGHT, dtype=np.float32),
        serial=camera.serial + SERIAL,
    )


def separate_cameras(camera: CameraCalibration) -> CameraCalibration:
    """Two cameras with lenses on a bracket, not parallel, whose rectified frame is the stereo camera's frame."""
    centre, per_px = np.array([camera.cx_px, camera.cy_px]), camera.width_px / 640.0
    left, right = (
        SeparateCamera(
            K=camera_matrix(factor * camera.fx_px, factor * camera.fy_px, *(centre + per_px * np.array(off)).tolist()),
            distortion=np.array(lens, dtype=np.float32),
        )
        for factor, off, lens in zip(_FOCAL_FACTORS, _CENTRE_OFF_PX, (_LEFT, _RIGHT), strict=True)
    )
    turn = Rotation.from_rotvec(_RIGHT_TURN_DEG, degrees=True)
    T_left_right = homogeneous(turn.as_matrix(), _RIGHT_BESIDE_M)
    named = msgspec.structs.replace(camera, serial=camera.serial + _SEPARATE_SERIAL)
    return rectified_pair(named, left, right, np.asarray(np.linalg.inv(T_left_right), dtype=np.float64))


def through_lens(picture: UInt8Array, camera: CameraCalibration, lens: Float32Array | None) -> UInt8Array:
    """Distort a pinhole picture (height, width, 3) like a lens with coefficients (5,); None: no distortion."""
    if lens is None:
        return picture
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    u, v = _maps((camera.width_px, camera.height_px), tuple(K.ravel().tolist()), tuple(lens.tolist()))
    return np.asarray(cv2.remap(picture, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)


@lru_cache(maxsize=2)
def _maps(size: tuple[int, int], camera: tuple[float, ...], lens: tuple[float, ...]) -> Maps:
    """For each pixel of the distorted picture, its column and row [px] in the pinhole's."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64)
    K = np.array(camera).reshape(3, 3)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-6)
    ideal = cv2.undistortPoints(pixels[:, None], K, np.array(lens), P=K, criteria=criteria)
    places = np.asarray(ideal, dtype=np.float32).reshape(size[1], size[0], 2)
    return np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])
