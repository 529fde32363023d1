"""Rectification: pictures as two ideal cameras side by side would have taken them, and as grey values."""

import cv2
import msgspec
import numpy as np

from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, StereoImages


def grey(pixels: UInt8Array) -> UInt8Array:
    """A picture (height, width, 3) RGB or (height, width) as grey values (height, width)."""
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


class Rectifier:
    """Removes the lenses' distortion; keeps its maps as long as the calibration stays the same."""

    def __init__(self) -> None:
        self._known: tuple[float, ...] = ()
        self._maps: list[tuple[Float32Array, Float32Array] | None] = [None, None]

    def rectify(self, images: StereoImages) -> StereoImages:
        """The pair without distortion. Pictures whose calibration names none pass as they are.

        The two cameras are taken to be parallel; a rig that is not must deliver rectified pictures.
        """
        camera = images.calibration
        if camera.distortion is None and camera.distortion_right is None:
            return images
        self._prepare(camera)
        left, right = (
            _remapped(picture, maps) for picture, maps in zip((images.left, images.right), self._maps, strict=True)
        )
        ideal = msgspec.structs.replace(camera, distortion=None, distortion_right=None)
        return msgspec.structs.replace(images, left=left, right=right, calibration=ideal)

    def _prepare(self, camera: CameraCalibration) -> None:
        lenses = [
            np.zeros(5) if lens is None else np.asarray(lens, np.float64)
            for lens in (camera.distortion, camera.distortion_right)
        ]
        pinhole = (camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        known = (*pinhole, *lenses[0].tolist(), *lenses[1].tolist())
        if known == self._known:
            return
        K = np.array([[camera.fx_px, 0.0, camera.cx_px], [0.0, camera.fy_px, camera.cy_px], [0.0, 0.0, 1.0]])
        size = (camera.width_px, camera.height_px)
        self._maps = [_float_maps(K, lens, size) if np.any(lens != 0.0) else None for lens in lenses]
        self._known = known


def _float_maps(K: np.ndarray, lens: np.ndarray, size: tuple[int, int]) -> tuple[Float32Array, Float32Array]:
    u, v = cv2.initUndistortRectifyMap(K, lens, np.eye(3), K, size, cv2.CV_32FC1)
    return np.asarray(u, dtype=np.float32), np.asarray(v, dtype=np.float32)


def _remapped(picture: UInt8Array, maps: tuple[Float32Array, Float32Array] | None) -> UInt8Array:
    if maps is None:
        return picture
    return np.asarray(cv2.remap(picture, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)
