"""Small operations on pictures that several steps share."""

import cv2
import numpy as np

from dlokit.types.arrays import UInt8Array


def grey(pixels: UInt8Array) -> UInt8Array:
    """A picture (height, width, 3) RGB or (height, width) as grey values (height, width)."""
    if pixels.ndim == 2:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
