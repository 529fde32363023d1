"""A camera's whole view as a coloured cloud, without a model of table, arm or DLO, for setting up a cell."""

from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from dlokit.geometry.camera import back_project, baseline_m
from dlokit.skills.perception.rectification import grey, rectified
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, StereoImages

_WIDTH_PX = 700
"""Larger pictures are matched at a half or a third of their size, which is enough for a displayed cloud."""
_NEAREST_M, _FARTHEST_M = 0.35, 4.0
"""Range of depths [m]."""
_BLOCK_PX = 7
_MOST_POINTS = 40_000
"""Number of points that a browser draws smoothly."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneCloud:
    """Points on every surface in view."""

    points_world: Float32Array  # (N, 3) [m] in the frame of the camera's pose
    colours: UInt8Array  # (N, 3) RGB


def scene_cloud(images: CameraPictures) -> SceneCloud:
    """The surfaces in a pair or a depth image, in the frame of the camera's pose."""
    ideal = rectified(images)
    if isinstance(ideal, StereoImages):
        return _matched(ideal)
    return _cloud(ideal.depth_m, ideal.pixels, ideal.calibration)


def _matched(images: StereoImages) -> SceneCloud:
    factor = -(-images.calibration.width_px // _WIDTH_PX)
    camera = _smaller(images.calibration, factor)
    size = (camera.width_px, camera.height_px)
    left, right = (
        np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        for picture in (images.left, images.right)
    )
    widest_px = camera.fx_px * baseline_m(camera) / _NEAREST_M
    matcher = cv2.StereoSGBM_create(  # pyright: ignore[reportAttributeAccessIssue]  # missing in OpenCV's stubs
        minDisparity=0,
        numDisparities=16 * int(np.ceil(widest_px / 16)),
        blockSize=_BLOCK_PX,
        P1=8 * _BLOCK_PX**2,
        P2=32 * _BLOCK_PX**2,
        disp12MaxDiff=1,
        uniquenessRatio=10,
        speckleWindowSize=80,
        speckleRange=2,
    )
    disparity = np.asarray(matcher.compute(grey(left), grey(right)), dtype=np.float32) / np.float32(16.0)
    known = disparity > 0.0
    depth_m = np.where(known, camera.fx_px * baseline_m(camera) / np.where(known, disparity, 1.0), 0.0)
    return _cloud(depth_m.astype(np.float32), left, camera)


def _smaller(camera: CameraCalibration, factor: int) -> CameraCalibration:
    """The camera with pictures of a fraction of the size; pixel centres are at whole numbers."""
    return msgspec.structs.replace(
        camera,
        width_px=camera.width_px // factor,
        height_px=camera.height_px // factor,
        fx_px=camera.fx_px / factor,
        fy_px=camera.fy_px / factor,
        cx_px=(camera.cx_px + 0.5) / factor - 0.5,
        cy_px=(camera.cy_px + 0.5) / factor - 0.5,
    )


def _cloud(depth_m: Float32Array, picture: UInt8Array, camera: CameraCalibration) -> SceneCloud:
    rows, columns = np.nonzero((depth_m > _NEAREST_M) & (depth_m < _FARTHEST_M))
    # Random points: every n-th point would show stripes.
    some = np.random.default_rng(0).permutation(len(rows))[:_MOST_POINTS]
    rows, columns = rows[some], columns[some]
    points = back_project(np.column_stack([columns, rows]), depth_m[rows, columns], camera)
    shown = picture[rows, columns] if picture.ndim == 3 else np.repeat(picture[rows, columns, None], 3, axis=1)
    return SceneCloud(points_world=points.astype(np.float32), colours=shown)
