"""From disparities to points: reprojection, and the pixels in which the box may be seen."""

import cv2
import numpy as np

from dlokit.geometry.camera import back_project, baseline_m, project
from dlokit.skills.perception.cloud import drawn
from dlokit.skills.perception.config import BoxConfig
from dlokit.skills.perception.stereo import Disparity
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration


def box_outline(box: BoxConfig, camera: CameraCalibration) -> BoolArray:
    """Pixels (height, width) in which the box may be seen: all of them when the camera is within or beside it."""
    bounds = np.array([box.lower_world, box.upper_world])
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    seen = project(corners, camera)
    if np.any(seen.depth_m <= 0.0):
        return np.ones((camera.height_px, camera.width_px), dtype=np.bool_)
    outline = np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)
    hull = cv2.convexHull(np.clip(np.round(seen.pixels), -10_000, 10_000).astype(np.int32))
    cv2.fillConvexPoly(outline, hull, (1.0,))
    return outline > 0


def reproject(disparity: Disparity, camera: CameraCalibration) -> Float64Array:
    """Points (N, 3) [m] in the world of all known disparities, by ``Z = f B / d``."""
    rows, columns = drawn(np.isfinite(disparity.pixels) & (disparity.pixels > 0.0))
    d = disparity.pixels[rows, columns].astype(np.float64)
    pixels = np.column_stack([columns + disparity.window.left, rows + disparity.window.top])
    return back_project(pixels, camera.fx_px * baseline_m(camera) / d, camera)
