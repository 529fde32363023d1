"""Depth images of a bright cable that moves over a dark table, seen from straight above."""

import cv2
import numpy as np

from dlokit.geometry import pose
from dlokit.geometry.camera import project
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, DepthImage

HEIGHT_M = 0.8
RADIUS_M = 0.004
CAMERA = CameraCalibration(
    width_px=640,
    height_px=480,
    fx_px=615.0,
    fy_px=615.0,
    cx_px=319.5,
    cy_px=239.5,
    T_world_camera=pose((0.5, 0.0, HEIGHT_M), (0.0, 1.0, 0.0, 0.0)),  # x to the right, looking down
    serial="drawn",
)


def bow(shift_m: float) -> Float64Array:
    """The centre line (200, 3) [m] of a cable of about 0.4 m that lies on the table."""
    y = np.linspace(0.2, -0.2, 200)
    return np.column_stack([0.48 + shift_m - 1.5 * y**2, y, np.full(200, RADIUS_M)])


def picture(shift_m: float, stamp_ns: int = 0, noise_m: float = 0.001) -> DepthImage:
    """The cable moved by `shift_m` along x, with noise of the depth, steps of 1 mm and a hole in it."""
    rng = np.random.default_rng(round(abs(shift_m) * 1e6))
    pixels = rng.integers(20, 60, (480, 640, 3), dtype=np.uint8)
    line = np.round(project(bow(shift_m), CAMERA).pixels).astype(np.int32)
    shape = np.zeros((480, 640), dtype=np.uint8)
    cv2.polylines(shape, [line], isClosed=False, color=(1.0,), thickness=round(2 * RADIUS_M * 615.0 / HEIGHT_M))
    pixels[shape > 0] = 230
    depth_m = np.where(shape > 0, HEIGHT_M - 2 * RADIUS_M, HEIGHT_M) + rng.normal(0.0, noise_m, shape.shape)
    depth_m[230:245] = 0.0
    depth_m = (np.round(depth_m * 1000.0) / 1000.0).astype(np.float32)
    return DepthImage(stamp_ns=stamp_ns, pixels=pixels, depth_m=depth_m, calibration=CAMERA)
