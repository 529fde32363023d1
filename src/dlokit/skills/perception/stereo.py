"""Semi-global matching (Hirschmüller, TPAMI 2008), in the sheared frame of the table.

The right picture is first shifted, row by row, so that the table has disparity 0. Objects a few millimetres to
centimetres high then have small disparities, so a short search range suffices, and the slanted table appears
frontal to the matcher, which assumes frontal surfaces. Only the surroundings of the mask are matched.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.description.table import TABLE_TOP_M
from dlokit.geometry.camera import PlaneDisparity, back_project, baseline_m, plane_disparity
from dlokit.skills.perception.cloud import drawn
from dlokit.skills.perception.config import StereoConfig
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration

_SUBPIXELS = 16
"""OpenCV gives disparities in sixteenths of a pixel."""
_STEP_PX = 16
"""OpenCV wants the number of disparities to be a multiple of this."""


@dataclass(frozen=True, kw_only=True)
class Window:
    """A rectangle of the picture: columns from `left` to below `right`, rows from `top` to below `bottom` [px]."""

    left: int
    top: int
    right: int
    bottom: int


@dataclass(frozen=True, kw_only=True)
class Disparity:
    """Disparities of the pixels of a window."""

    window: Window
    pixels: Float32Array  # (height, width of the window) [px]; NaN where unknown


_PENALTY_SMALL, _PENALTY_LARGE = 8.0, 32.0
"""P1 for a disparity step of one, and P2 for larger steps, per pixel of the block."""
_LESS_SMOOTH = 0.25
"""Factor on both penalties where there is no mask: with the full ones the table around it hides a post of 20 mm."""
_UNIQUENESS_PERCENT = 0
"""Margin of a match over the second best [%]. A plain DLO along the rows is inherently ambiguous."""
_LEFT_RIGHT_PX = 2
"""Largest difference between matching left to right and right to left [px]."""
_LOWEST_M = -0.02
"""Lowest height above the table that is searched [m]."""
SMOOTHING_PX = 9
"""Side of the window in which disparities of the mask are averaged [px], odd."""
_SURROUNDINGS = 0.25
"""Fraction of the brightness, from 0 to 1, that pixels outside the DLO keep. The table's full texture would pull a
lifted DLO that runs along the rows down to the table; without texture, a DLO on the table would have no reference."""
_LARGEST_SPREAD_PX = 1.0
"""Pixels in whose window the disparities spread more than this (standard deviation) are at an edge [px]."""


class StereoMatcher:
    """Finds the disparity of masked pixels, over the table."""

    def __init__(self, config: StereoConfig) -> None:
        self._config = config

    def match(
        self,
        left: UInt8Array,
        right: UInt8Array,
        mask: BoolArray,
        mask_right: BoolArray,
        camera: CameraCalibration,
    ) -> Disparity | None:
        """Disparities of the masked pixels of two rectified grey pictures (height, width); None if none is masked.

        `mask_right` marks the DLO's pixels in the right picture.
        """
        lowest, count = self._search_range(camera)
        window = window_around(mask, 4 * self._config.block_px, lowest + count)
        if window is None:
            return None
        plane = plane_disparity(camera, TABLE_TOP_M)
        left, right = _dimmed(left, mask, window), _dimmed(right, mask_right, window)
        raw = self._raw(left, right, window, plane, lowest, count)
        inside = mask[window.top : window.bottom, window.left : window.right]
        smooth = _smoothed(np.where(inside, raw, np.float32(np.nan)))
        return Disparity(window=window, pixels=_with_plane(smooth, window, plane))

    def match_all(self, left: UInt8Array, right: UInt8Array, camera: CameraCalibration) -> Disparity:
        """Disparities of all pixels of two rectified grey pictures (height, width), of which none is a DLO's."""
        height, width = left.shape
        window = Window(left=0, top=0, right=width, bottom=height)
        plane = plane_disparity(camera, TABLE_TOP_M)
        raw = self._raw(left, right, window, plane, *self._search_range(camera), smoothness=_LESS_SMOOTH)
        return Disparity(window=window, pixels=_with_plane(raw, window, plane))

    def _raw(
        self,
        left: UInt8Array,
        right: UInt8Array,
        window: Window,
        plane: PlaneDisparity,
        lowest: int,
        count: int,
        smoothness: float = 1.0,
    ) -> Float32Array:
        """Disparities relative to the table (height, width of the window) [px]; NaN where unknown."""
        matcher = cv2.StereoSGBM_create(  # pyright: ignore[reportAttributeAccessIssue]  # missing in OpenCV's stubs
            minDisparity=lowest,
            numDisparities=count,
            blockSize=self._config.block_px,
            P1=round(smoothness * _PENALTY_SMALL * self._config.block_px**2),
            P2=round(smoothness * _PENALTY_LARGE * self._config.block_px**2),
            disp12MaxDiff=_LEFT_RIGHT_PX,
            uniquenessRatio=_UNIQUENESS_PERCENT,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
        crop = np.ascontiguousarray(left[window.top : window.bottom, window.left : window.right])
        sixteenths = matcher.compute(crop, _sheared(right, window, plane))
        unknown = sixteenths < lowest * _SUBPIXELS
        result = sixteenths.astype(np.float32) / np.float32(_SUBPIXELS)
        result[unknown] = np.nan
        return result

    def _search_range(self, camera: CameraCalibration) -> tuple[int, int]:
        """Lowest disparity relative to the table, and the number of disparities searched [px]."""
        table = plane_disparity(camera, TABLE_TOP_M)
        corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * [camera.width_px - 1, camera.height_px - 1]
        spans = [
            plane_disparity(camera, TABLE_TOP_M + height).at(corners[:, 0], corners[:, 1])
            - table.at(corners[:, 0], corners[:, 1])
            for height in (_LOWEST_M, self._config.highest_m)
        ]
        # Two pixels more on each side: the believed camera pose is a little off, and a match at the very end of
        # the range has no neighbour to interpolate with.
        lowest = int(np.floor(np.min(spans))) - 2
        count = int(np.ceil(np.max(spans))) + 2 - lowest
        return lowest, -(-count // _STEP_PX) * _STEP_PX


def window_around(mask: BoolArray, margin_px: int, reach_px: int = 0) -> Window | None:
    """The smallest window around a mask (height, width), with a margin, and `reach_px` more on the left.

    None if the mask is empty.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return None
    height, width = mask.shape
    return Window(
        left=max(0, int(columns[0]) - margin_px - reach_px),
        right=min(width, int(columns[-1]) + 1 + margin_px),
        top=max(0, int(rows[0]) - margin_px),
        bottom=min(height, int(rows[-1]) + 1 + margin_px),
    )


def _dimmed(picture: UInt8Array, mask: BoolArray, window: Window) -> UInt8Array:
    """The picture, darkened outside the mask in the rows of `window`, with soft edges like a real picture's."""
    rows = slice(window.top, window.bottom)
    kept = np.where(mask[rows], picture[rows], np.uint8(0))
    result = picture.copy()
    soft = cv2.GaussianBlur(kept, (3, 3), 0.0)
    result[rows] = cv2.addWeighted(picture[rows], _SURROUNDINGS, soft, 1.0 - _SURROUNDINGS, 0.0)
    return result


def _sheared(right: UInt8Array, window: Window, plane: PlaneDisparity) -> UInt8Array:
    """The window of the right picture in which the table has disparity 0 to the same window of the left."""
    constant = plane.per_u * window.left + plane.per_v * window.top + plane.constant
    window_to_picture = np.array(
        [[1.0 - plane.per_u, -plane.per_v, window.left - constant], [0.0, 1.0, float(window.top)]]
    )
    size = (window.right - window.left, window.bottom - window.top)
    return np.asarray(
        cv2.warpAffine(
            right,
            window_to_picture,
            size,
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.uint8,
    )


def _with_plane(relative: Float32Array, window: Window, plane: PlaneDisparity) -> Float32Array:
    """Disparities between the pictures from those between the left and the sheared right one."""
    u = np.arange(window.left, window.right, dtype=np.float64)[None, :]
    v = np.arange(window.top, window.bottom, dtype=np.float64)[:, None]
    # Column u matches column u - r of the sheared picture, so the shift is taken at u - r.
    return (relative * (1.0 - plane.per_u) + plane.at(u, v)).astype(np.float32)


def _smoothed(disparity: Float32Array) -> Float32Array:
    """Means over the known pixels of a window around each known pixel; NaN where they disagree."""
    known = np.isfinite(disparity)
    values = np.where(known, disparity, np.float32(0.0))
    count = _box_sum(known.astype(np.float32))
    safe = np.maximum(count, np.float32(1.0))
    mean = _box_sum(values) / safe
    variance = _box_sum(values * values) / safe - mean * mean
    good = known & (variance <= _LARGEST_SPREAD_PX**2)
    return np.where(good, mean, np.float32(np.nan)).astype(np.float32)


def _box_sum(values: NDArray[np.float32]) -> NDArray[np.float32]:
    window = (SMOOTHING_PX, SMOOTHING_PX)
    sums = cv2.boxFilter(values, -1, window, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums, dtype=np.float32)


def reproject(disparity: Disparity, camera: CameraCalibration) -> Float64Array:
    """Points (N, 3) [m] in the world of all known disparities, by ``Z = f B / d``."""
    rows, columns = drawn(np.isfinite(disparity.pixels) & (disparity.pixels > 0.0))
    d = disparity.pixels[rows, columns].astype(np.float64)
    pixels = np.column_stack([columns + disparity.window.left, rows + disparity.window.top])
    return back_project(pixels, camera.fx_px * baseline_m(camera) / d, camera)
