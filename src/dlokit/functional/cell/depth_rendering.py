"""The cell's depth camera: a model of an Intel RealSense D435 with its typical errors.

The camera finds depth by matching the pictures of two infrared imagers. The model works on the grid of the colour
image, to which the depth is aligned: only surfaces seen by both imagers have a depth; matching widens objects in front;
edge pixels get a depth in between; disparity errors are correlated; depths are whole millimetres, 0 if unknown.
"""

from typing import Any

import cv2
import numpy as np

from dlokit.description.default_cameras import d435_calibration
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.rendering import FARTHEST_M, PictureNoise, Rig, disturbed, installed
from dlokit.types.arrays import BoolArray, Float32Array
from dlokit.types.image import CameraCalibration, DepthImage

DEPTH_CAMERA = "d435"
BASELINE_M = 0.050
"""Distance between the two infrared imagers, from the data sheet [m]."""
LEFT_IMAGER_M = 0.0147
"""Offset of the left imager from the colour sensor, towards the right imager: the extrinsics of a device [m]."""
INFRARED_FOCAL_PX = 383.0
"""Focal length of the imagers at 640 x 480 px: wider than the colour sensor, so that disparities are small [px]."""
DISPARITY_NOISE_PX = 0.1
"""Standard deviation of the disparity [px], as published for textured surfaces; 5 mm of depth at 1 m."""
NOISE_LENGTH_PX = 4.0
"""Standard deviation of the filter that correlates the noise [px of the colour image]: neighbours share most of their
matching windows, so that a mean over a DLO's width does not reduce the noise."""
FATTENING_PX = 7
"""Side of the window in which the nearest surface wins [px of the colour image]: matching windows are 5 px of the
imagers wide, and the object in front has the stronger texture."""
EDGE_PX = 0.25
"""Disparities that differ by more than this within the window are an edge [px of the imagers]: 13 mm at 1 m, several
times the difference caused by the slope of the table."""
FLYING_FRACTION = 0.3
"""Fraction of the pixels at an edge that get a depth between both surfaces."""
NEAREST_M = 0.2
"""Shortest depth that the camera measures at this size of the picture [m]."""
DEPTH_STEP_M = 0.001
"""Unit of the depth that the camera sends [m]."""
_NOISE_SIDE = 512
"""Margin of the noise field around a picture [px]: each picture uses another part of the field."""
_OCCLUSION_TOLERANCE_PX = 0.5
"""A pixel overlapped by less than this is not hidden by its neighbour: the surface is only inclined [px]."""
_STREAM = 0xD435


def depth_camera(installation: Installation = PAPERS_CELL) -> CameraCalibration:
    """The true calibration of the cell's depth camera, with its serial number and picture size."""
    return installed(d435_calibration(), installation)


class DepthRig(Rig):
    """The depth camera. Its true pose and the believed one differ by a small error drawn from the seed."""

    def __init__(self, config: CellConfig, *, seed: int, installation: Installation = PAPERS_CELL) -> None:
        self.true_calibration = camera = depth_camera(installation)
        super().__init__(camera.width_px, camera.height_px, shadows=config.shadows)
        self._sigma = config.image_noise_sigma
        rng = np.random.default_rng([seed, _STREAM])
        self.calibration = disturbed(self.true_calibration, config, rng)
        self._rng = rng
        self._noise: PictureNoise | None = None
        self._disparity_noise: Float32Array | None = None

    def capture(self, model: Any, data: Any, stamp_ns: int) -> DepthImage:
        """Colour and depth of the present moment; poses in `data` must be up to date."""
        camera = self.true_calibration
        renderer = self._renderer_for(model)
        if self._noise is None or self._disparity_noise is None:
            self._noise = PictureNoise(self._sigma, *self._size, self._rng)
            self._disparity_noise = _correlated((camera.height_px, camera.width_px), self._rng)
        colour = self._noise.added_to(renderer.render(data, DEPTH_CAMERA))
        true_m = renderer.depth_m(data, DEPTH_CAMERA)
        return DepthImage(
            stamp_ns=stamp_ns,
            frame="camera",
            pixels=colour,
            depth_m=measured(true_m, camera.fx_px, self._part_of(self._disparity_noise, true_m.shape), self._rng),
            calibration=self.calibration,
        )

    def _part_of(self, noise: Float32Array, shape: tuple[int, ...]) -> Float32Array:
        top, left = self._rng.integers(0, _NOISE_SIDE, 2)
        return noise[top : top + shape[0], left : left + shape[1]]


def measured(
    true_m: Float32Array, focal_px: float, disparity_noise_px: Float32Array, rng: np.random.Generator
) -> Float32Array:
    """The depth that the camera reports (height, width) [m] of true depths in the colour image; 0 where unknown.

    `focal_px` is the colour sensor's; `disparity_noise_px` (height, width) is the error of the imagers' disparity.
    """
    per_depth = np.float32(INFRARED_FOCAL_PX * BASELINE_M)
    true = per_depth / true_m  # disparities of the imagers [px]
    window = np.ones((FATTENING_PX, FATTENING_PX), dtype=np.uint8)
    nearest, farthest = (np.asarray(change(true, window), dtype=np.float32) for change in (cv2.dilate, cv2.erode))
    edge = nearest - farthest > EDGE_PX
    flying = edge & (rng.random(true.shape, dtype=np.float32) < FLYING_FRACTION)
    between = farthest + rng.random(true.shape, dtype=np.float32) * (nearest - farthest)
    disparity = np.where(flying, between, np.where(nearest - true > EDGE_PX, nearest, true)) + disparity_noise_px
    depth_m = per_depth / np.maximum(disparity, np.float32(1e-3))
    seen = (true_m < FARTHEST_M) & (depth_m > NEAREST_M) & (depth_m < FARTHEST_M)
    for beside_m in (LEFT_IMAGER_M, LEFT_IMAGER_M + BASELINE_M):
        seen &= ~hidden_from(true_m, focal_px * beside_m)
    steps = np.round(np.where(seen, depth_m, np.float32(0.0)) / np.float32(DEPTH_STEP_M))
    return (steps.astype(np.float64) * DEPTH_STEP_M).astype(np.float32)


def hidden_from(true_m: Float32Array, focal_times_offset: float) -> BoolArray:
    """Pixels (height, width) whose surface an imager to the right does not see; its offset [m] times f [px].

    In a row of that imager a pixel is at u - d. A surface is hidden where a pixel farther right is to the left of it.
    """
    columns = np.arange(true_m.shape[1], dtype=np.float32)
    place = columns - np.float32(focal_times_offset) / true_m
    to_the_right = np.minimum.accumulate(place[:, ::-1], axis=1)[:, ::-1]
    return place > to_the_right + _OCCLUSION_TOLERANCE_PX


def _correlated(shape: tuple[int, int], rng: np.random.Generator) -> Float32Array:
    """A field of noise, larger than a picture of `shape`, of standard deviation `DISPARITY_NOISE_PX`."""
    white = rng.standard_normal((shape[0] + _NOISE_SIDE, shape[1] + _NOISE_SIDE), dtype=np.float32)
    smooth = np.asarray(cv2.GaussianBlur(white, (0, 0), NOISE_LENGTH_PX), dtype=np.float32)
    return smooth * np.float32(DISPARITY_NOISE_PX / smooth.std())
