"""Where an outline really runs: the edge of what has changed between two pictures, along the outline's normals."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.types.arrays import BoolArray, Float32Array, UInt8Array

Array = NDArray[np.float64]

_BLUR_PX = 0.7
_STEP_PX = 0.5
_EDGE_SHARE = 0.15
"""Share of the difference within the arm at which its edge lies: low, as rounded parts are dim at their edges."""
_LEAST_EDGE = 10.0
"""Differences below this are noise [grey levels]."""
_LEAST_DIFFERENCE = 25.0
"""The arm must differ from the table by this [grey levels]."""


@dataclass(frozen=True, kw_only=True)
class Edges:
    """How far from each of K points the edge was found."""

    offsets_px: Array  # (K,) along the normal, positive outwards
    found: BoolArray  # (K,)


def difference(picture: UInt8Array, background: UInt8Array) -> Float32Array:
    """How much each pixel has changed (height, width) [grey levels], between pictures (height, width, 3)."""
    changed = np.asarray(cv2.absdiff(picture, background)).astype(np.float32).mean(axis=2)
    return np.asarray(cv2.GaussianBlur(changed, (0, 0), _BLUR_PX), dtype=np.float32)


def find_edges(changed: Float32Array, pixels: Array, normals: Array, reach_px: float) -> Edges:
    """The outermost edge of what has changed within `reach_px` of pixels (K, 2), along normals (K, 2)."""
    steps = np.arange(-reach_px, reach_px + 0.5 * _STEP_PX, _STEP_PX)
    places = (pixels[:, None] + normals[:, None] * steps[:, None]).astype(np.float32)
    profile = np.asarray(cv2.remap(changed, places[..., 0], places[..., 1], cv2.INTER_LINEAR), dtype=np.float64)
    within = np.median(profile[:, steps < -0.5 * reach_px], axis=1)
    beside = np.median(profile[:, steps > 0.7 * reach_px], axis=1)
    level = np.maximum(_EDGE_SHARE * within, _LEAST_EDGE)
    above = profile >= level[:, None]
    last = len(steps) - 1 - np.argmax(above[:, ::-1], axis=1)
    found = above.any(axis=1) & (last < len(steps) - 1) & (within > _LEAST_DIFFERENCE) & (beside < level)
    rows, last = np.arange(len(pixels)), np.minimum(last, len(steps) - 2)
    high, low = profile[rows, last], profile[rows, last + 1]
    share = (high - level) / np.maximum(high - low, 1e-6)
    return Edges(offsets_px=steps[last] + _STEP_PX * share, found=found)
