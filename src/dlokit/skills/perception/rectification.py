"""Rectification: pictures as ideal cameras without lenses would have taken them, and as grey values."""

from functools import lru_cache
from typing import overload

import cv2
import msgspec
import numpy as np

from dlokit.geometry.camera import camera_matrix
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages


def grey(pixels: UInt8Array) -> UInt8Array:
    """A picture (height, width, 3) RGB or (height, width) as grey values (height, width)."""
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


Maps = tuple[Float32Array, Float32Array]
"""For each pixel of the ideal picture the column and the row [px] of the picture as it was taken."""


@overload
def rectified(images: StereoImages) -> StereoImages: ...
@overload
def rectified(images: DepthImage) -> DepthImage: ...
def rectified(images: CameraPictures) -> CameraPictures:
    """The pictures without distortion. Pictures whose calibration names none pass as they are.

    The two cameras of a pair are taken to be parallel; a rig that is not must deliver rectified pictures. Depths are
    moved without mixing neighbours: a mean of two surfaces would be a point in the air between them.
    """
    camera = images.calibration
    if camera.distortion is None and camera.distortion_right is None:
        return images
    if isinstance(images, DepthImage):
        maps = None if camera.distortion is None else _maps(*_pinhole(camera), tuple(camera.distortion.tolist()))
        return msgspec.structs.replace(
            images,
            pixels=_remapped(images.pixels, maps),
            depth_m=_moved_depth(images.depth_m, maps),
            calibration=msgspec.structs.replace(camera, distortion=None, distortion_right=None),
        )
    left, right = (
        _remapped(picture, None if lens is None else _maps(*_pinhole(camera), tuple(lens.tolist())))
        for picture, lens in ((images.left, camera.distortion), (images.right, camera.distortion_right))
    )
    ideal = msgspec.structs.replace(camera, distortion=None, distortion_right=None)
    return msgspec.structs.replace(images, left=left, right=right, calibration=ideal)


def _pinhole(camera: CameraCalibration) -> tuple[int, int, float, float, float, float]:
    return camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


# The two lenses of a pair, and the two of the pair before while a calibration changes.
@lru_cache(maxsize=4)
def _maps(
    width_px: int, height_px: int, fx_px: float, fy_px: float, cx_px: float, cy_px: float, lens: tuple[float, ...]
) -> Maps | None:
    """The maps of one lens with coefficients k1, k2, p1, p2, k3; None for a lens without distortion."""
    if not any(lens):
        return None
    K = camera_matrix(fx_px, fy_px, cx_px, cy_px)
    u, v = cv2.initUndistortRectifyMap(K, np.array(lens), np.eye(3), K, (width_px, height_px), cv2.CV_32FC1)
    return np.asarray(u, dtype=np.float32), np.asarray(v, dtype=np.float32)


def _remapped(picture: UInt8Array, maps: Maps | None) -> UInt8Array:
    if maps is None:
        return picture
    return np.asarray(cv2.remap(picture, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)


def _moved_depth(depth_m: Float32Array, maps: Maps | None) -> Float32Array:
    if maps is None:
        return depth_m
    return np.asarray(cv2.remap(depth_m, maps[0], maps[1], cv2.INTER_NEAREST), dtype=np.float32)
