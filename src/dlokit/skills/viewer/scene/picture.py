"""The camera's picture on the page, with the estimated shape and the goal projected into it."""

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.geometry.camera import project
from dlokit.skills.viewer import palette
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration

PICTURE_WIDTH_PX = 320
"""Width of the camera picture that is sent to the browser [px]: half a picture, a quarter of its bytes."""


def thumbnail(picture: UInt8Array, width_px: int) -> UInt8Array:
    """A picture (H, W, 3) or (H, W) as RGB at most `width_px` wide, its proportions kept."""
    rgb = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    if rgb.shape[1] <= width_px:
        return rgb
    height_px = max(1, round(rgb.shape[0] * width_px / rgb.shape[1]))
    return np.asarray(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def with_shapes(
    picture: UInt8Array,
    calibration: CameraCalibration,
    *,
    state_world: Float64Array | None,
    goal_world: Float64Array | None,
) -> UInt8Array:
    """A thumbnail (h, w, 3) with the goal (M, 3) [m] as a line and the nodes of the state (M, 3) [m] as dots."""
    drawn = np.ascontiguousarray(picture).copy()
    scale = picture.shape[1] / calibration.width_px
    if goal_world is not None:
        cv2.polylines(drawn, [_pixels(goal_world, calibration, scale)], False, palette.GOAL.color, 1, cv2.LINE_AA)
    if state_world is not None:
        for u, v in _pixels(state_world, calibration, scale):
            cv2.circle(drawn, (int(u), int(v)), 2, palette.STATE.color, -1, cv2.LINE_AA)
    return drawn


def _pixels(nodes_world: Float64Array, calibration: CameraCalibration, scale: float) -> NDArray[np.int32]:
    projected = project(nodes_world, calibration)
    # Behind or far beside the camera nothing is drawn that could be seen.
    return np.clip(projected.pixels[projected.depth_m > 0.0] * scale, -10_000, 10_000).round().astype(np.int32)
