"""Rectifies pictures, as if ideal, parallel pinhole cameras had taken them; and converts them to grey values."""

from functools import lru_cache
from typing import overload

import cv2
import msgspec
import numpy as np

from dlokit.geometry.camera import SIDES, Side, camera_alone, camera_matrix, turn_to_rectified
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages


def grey(pixels: UInt8Array) -> UInt8Array:
    """A picture (height, width, 3) RGB or (height, width) as grey values (height, width)."""
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


Maps = tuple[Float32Array, Float32Array]
"""For each pixel of the ideal picture the column and the row [px] of the picture as it was taken."""
_Intrinsics = tuple[float, float, float, float]
"""fx, fy, cx, cy [px]."""


@overload
def rectified(images: StereoImages) -> StereoImages: ...
@overload
def rectified(images: DepthImage) -> DepthImage: ...
def rectified(images: CameraPictures) -> CameraPictures:
    """The pictures without lens distortion and, for a pair, as from parallel cameras, by their calibration.

    Pictures whose calibration has no distortion and no raw cameras are returned unchanged. Depths are moved without
    mixing neighbours: a mean of two surfaces would be a point in the air between them.
    """
    camera = images.calibration
    if camera.distortion is None and camera.distortion_right is None and camera.raw_left is None:
        return images
    ideal = msgspec.structs.replace(camera, distortion=None, distortion_right=None, raw_left=None, raw_right=None)
    if isinstance(images, DepthImage):
        maps = maps_of(camera, 0)
        return msgspec.structs.replace(
            images,
            pixels=_remapped(images.pixels, maps),
            depth_m=_moved_depth(images.depth_m, maps),
            calibration=ideal,
        )
    left, right = (
        _remapped(picture, maps_of(camera, side))
        for side, picture in zip(SIDES, (images.left, images.right), strict=True)
    )
    return msgspec.structs.replace(images, left=left, right=right, calibration=ideal)


def maps_of(camera: CameraCalibration, side: Side) -> Maps | None:
    """The maps (height, width) of one camera's pictures; None if they are ideal already."""
    taken = camera_alone(camera, side)
    lens = None if taken.distortion is None else tuple(taken.distortion.tolist())
    turn = turn_to_rectified(camera, side)
    if _intrinsics(taken) == _intrinsics(camera) and not any(lens or ()) and np.array_equal(turn, np.eye(3)):
        return None
    size = (camera.width_px, camera.height_px)
    return _maps(size, _intrinsics(camera), _intrinsics(taken), lens or (0.0,) * 5, tuple(turn.ravel().tolist()))


def _intrinsics(camera: CameraCalibration) -> _Intrinsics:
    return camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


# The two cameras of a pair, and of the previous pair while a calibration changes.
@lru_cache(maxsize=4)
def _maps(
    size: tuple[int, int], ideal: _Intrinsics, taken: _Intrinsics, lens: tuple[float, ...], turn: tuple[float, ...]
) -> Maps:
    """The maps of a camera with a lens k1, k2, p1, p2, k3 that is turned by the inverse of `turn` (3, 3)."""
    R, K_taken, K_ideal = np.array(turn).reshape(3, 3), camera_matrix(*taken), camera_matrix(*ideal)
    u, v = cv2.initUndistortRectifyMap(K_taken, np.array(lens), R, K_ideal, size, cv2.CV_32FC1)
    return np.asarray(u, dtype=np.float32), np.asarray(v, dtype=np.float32)


def _remapped(picture: UInt8Array, maps: Maps | None) -> UInt8Array:
    if maps is None:
        return picture
    return np.asarray(cv2.remap(picture, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)


def _moved_depth(depth_m: Float32Array, maps: Maps | None) -> Float32Array:
    if maps is None:
        return depth_m
    return np.asarray(cv2.remap(depth_m, maps[0], maps[1], cv2.INTER_NEAREST), dtype=np.float32)
