"""Segmentation by colour, with its settings: pixels with the DLO's hue are DLO."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dlokit.ranges import check_ranges
from dlokit.skills.perception.base import Segmentation
from dlokit.types.image import Image, Mask

Hue = Annotated[float, Meta(ge=0.0, le=360.0)]
GreyLevel = Annotated[int, Meta(ge=0, le=255)]


@dataclass(frozen=True, kw_only=True)
class ColourConfig:
    """By colour, in hue, saturation and value: for a coloured DLO on a background of any brightness."""

    name: ClassVar[str] = "colour"

    lowest_hue_deg: Hue = 30.0
    """Where the range of hues begins [deg], 0 to 360: 0 red, 60 yellow, 120 green, 240 blue."""
    highest_hue_deg: Hue = 75.0
    """Where the range of hues ends [deg]; below the begin, it passes through red."""
    least_saturation: GreyLevel = 80
    """0 (grey) to 255 (pure colour)."""
    least_value: GreyLevel = 80
    """0 (black) to 255."""

    def __post_init__(self) -> None:
        check_ranges(self, "perception.segmentation")

    def build(self) -> Segmentation:
        """The filter with these settings."""
        return Colour(self)


class Colour:
    """Which pixels have the colour."""

    def __init__(self, config: ColourConfig) -> None:
        self._config = config

    def mask(self, image: Image) -> Mask:
        """Pixels within the range of hues, coloured and light enough. A grey picture has no such pixels."""
        if image.pixels.ndim == 2:
            return Mask(pixels=np.zeros(image.pixels.shape, dtype=np.bool_))
        # Here, because every process loads the settings, and only one process segments pictures.
        import cv2

        hsv = np.asarray(cv2.cvtColor(image.pixels, cv2.COLOR_RGB2HSV), dtype=np.uint8)
        # OpenCV counts hues in steps of two degrees, so that they fit a byte.
        low, high = round(self._config.lowest_hue_deg / 2), round(self._config.highest_hue_deg / 2)
        hue = hsv[..., 0]
        in_hue = (hue >= low) & (hue <= high) if low <= high else (hue >= low) | (hue <= high)
        vivid = (hsv[..., 1] >= self._config.least_saturation) & (hsv[..., 2] >= self._config.least_value)
        return Mask(pixels=in_hue & vivid)
