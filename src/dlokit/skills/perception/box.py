"""The box filter: what lies outside a box of the world is not DLO."""

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.skills.perception.config import BoxConfig
from dlokit.skills.perception.projection import project
from dlokit.types.arrays import BoolArray
from dlokit.types.image import CameraCalibration


def inside_box(points_world: NDArray[np.floating], box: BoxConfig) -> BoolArray:
    """Whether each point (N, 3) [m] lies in the box, its faces included, (N,)."""
    lower, upper = np.array(box.lower_world), np.array(box.upper_world)
    return np.all((points_world >= lower) & (points_world <= upper), axis=1)


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
