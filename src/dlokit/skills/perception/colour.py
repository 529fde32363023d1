"""Segmentation by colour: what has the DLO's hue is DLO."""

import cv2
import numpy as np

from dlokit.skills.perception.colour_config import ColourConfig
from dlokit.types.image import Image, Mask


class Colour:
    """Which pixels have the colour."""

    def __init__(self, config: ColourConfig) -> None:
        self._config = config

    def mask(self, image: Image) -> Mask:
        """Pixels within the range of hues, coloured and light enough. A grey picture has no colour: nothing."""
        if image.pixels.ndim == 2:
            return Mask(pixels=np.zeros(image.pixels.shape, dtype=np.bool_))
        hsv = np.asarray(cv2.cvtColor(image.pixels, cv2.COLOR_RGB2HSV), dtype=np.uint8)
        # OpenCV counts hues in steps of two degrees, so that they fit a byte.
        low, high = round(self._config.lowest_hue_deg / 2), round(self._config.highest_hue_deg / 2)
        hue = hsv[..., 0]
        in_hue = (hue >= low) & (hue <= high) if low <= high else (hue >= low) | (hue <= high)
        vivid = (hsv[..., 1] >= self._config.least_saturation) & (hsv[..., 2] >= self._config.least_value)
        return Mask(pixels=in_hue & vivid)
