"""The cameras of the paper's rig and of a depth camera in its place, as calibrations in the world."""

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.geometry.camera import centred_camera
from dlokit.types.image import CameraCalibration

STEREO_BASELINE_M = 0.0998
"""Distance of the two cameras, as published for the authors' camera [m]."""
REFERENCE_WIDTH_PX = 640
REFERENCE_FOCAL_PX = 722.0
"""Focal length at `REFERENCE_WIDTH_PX` [px]; it scales with the width."""
T_CAMERA_WORLD = (
    (-0.9983, -0.0537, -0.0224, 0.570),
    (-0.0343, 0.8540, -0.5191, 0.016),
    (0.0470, -0.5174, -0.8544, 1.159),
    (0.0, 0.0, 0.0, 1.0),
)
"""The authors' published camera pose, ``p_camera = T p_world``, rounded to four digits; the camera is at
(0.515, 0.617, 1.011) m and looks at the middle of the table."""

D435_SIZE_PX = (640, 480)
"""Width and height of the depth camera's pictures [px]: a D435 sends this size at 30 Hz over any USB port."""
D435_FOCAL_PX = 615.0
"""Focal length of a D435's colour sensor at this size [px]."""
D435_NEARER_M = 0.175
"""The depth camera is this much nearer to the table than the stereo camera [m], so that with its shorter focal length
the table fills its pictures alike."""


def default_calibration(width_px: int = 640, height_px: int = 560) -> CameraCalibration:
    """The rectified stereo camera of the paper's rig at a picture size; the principal point is the centre."""
    focal_px = REFERENCE_FOCAL_PX * width_px / REFERENCE_WIDTH_PX
    T = np.array(T_CAMERA_WORLD, dtype=np.float64)
    # The published rotation is rounded: take the nearest true rotation.
    u, _, vt = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ vt
    camera = centred_camera(width_px, height_px, focal_px, geometry.inverse(geometry.pose_from_matrix(T)))
    return msgspec.structs.replace(camera, baseline_m=STEREO_BASELINE_M, serial="simulated", date="2022-05-15")


def d435_calibration() -> CameraCalibration:
    """A RealSense D435 on the line of sight of the stereo camera: the colour sensor, to which its depth is aligned."""
    stereo = default_calibration(*D435_SIZE_PX)
    T = stereo.T_world_camera
    nearer = geometry.pose(T.position_m + D435_NEARER_M * geometry.rotation(T)[:, 2], T.wxyz)
    camera = centred_camera(*D435_SIZE_PX, D435_FOCAL_PX, nearer)
    return msgspec.structs.replace(camera, serial="simulated D435", date=stereo.date)
