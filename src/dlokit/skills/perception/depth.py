"""Computes the DLO's surface from a depth image, without flying pixels, edges and holes.

A depth camera errs at the edge of a surface in front of another: it mixes both depths, widens the nearer surface, or
returns no depth. Therefore only pixels with the same depth as most DLO pixels around them are used, and each gets
their mean.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dlokit.geometry.camera import back_project
from dlokit.skills.perception.cloud import drawn
from dlokit.skills.perception.stereo import SMOOTHING_PX, window_around
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import DepthImage

_SAME_SURFACE = 0.015
"""Pixels whose depths differ by less than this fraction show one surface: three times the noise at 1 m of a camera with
a baseline of 50 mm, and less than the height over the table at which an edge of a DLO starts to matter."""
_LEAST_AGREEING = 0.6
"""Fraction of the known pixels around a pixel that must show the same surface. At a straight edge it is a half."""
_LEAST_NEIGHBOURS = 5
"""Known pixels in the window of a pixel that is used, itself included: an isolated one is noise."""


def surface_of_depth(image: DepthImage, mask: BoolArray) -> Float64Array:
    """Points (N, 3) [m] in the world of the masked pixels (height, width) that have a reliable depth."""
    window = window_around(mask, margin_px=0)
    if window is None:
        return np.zeros((0, 3))
    part = np.s_[window.top : window.bottom, window.left : window.right]
    depth = image.depth_m[part]
    known = mask[part] & (depth > 0.0)
    rows, columns = drawn(known)
    padded = np.pad(np.where(known, depth, np.float32(0.0)), SMOOTHING_PX // 2)
    around = sliding_window_view(padded, (SMOOTHING_PX, SMOOTHING_PX))
    neighbours = around[rows, columns].reshape(len(rows), SMOOTHING_PX**2)  # (K, side²) [m]; 0 where not known
    own = depth[rows, columns]
    agreeing = np.abs(neighbours - own[:, None]) < np.float32(_SAME_SURFACE) * own[:, None]
    agree, count = agreeing.sum(axis=1), (neighbours > 0.0).sum(axis=1)
    trusted = (agree >= _LEAST_AGREEING * count) & (count >= _LEAST_NEIGHBOURS)
    mean = np.where(agreeing, neighbours, 0.0).sum(axis=1, dtype=np.float64) / np.maximum(agree, 1)
    pixels = np.column_stack([columns + window.left, rows + window.top])
    return back_project(pixels[trusted], mean[trusted], image.calibration)
