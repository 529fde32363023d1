"""Segmentation by colour, with its settings: pixels with the DLO's hue are DLO."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dlokit.ranges import check_ranges
from dlokit.skills.perception.base import Segmentation
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import Image, Mask

Hue = Annotated[float, Meta(ge=0.0, le=360.0)]
GreyLevel = Annotated[int, Meta(ge=0, le=255)]

_LEAST_COLOURED = 30.0
"""Least median difference of the largest and the smallest of R, G and B of a coloured DLO: the hue of less is noise."""
_MOST = 95.0
"""Percentage of the DLO's pixels that a proposal covers in each setting; the others are blurred edges."""
_MARGIN, _LEAST_SATURATION = 25, 30
"""Margin of the proposed least saturation and value, and the smallest saturation that is proposed."""
_HUE_MARGIN_DEG, _LEAST_HALF_DEG = 5.0, 12.0
"""Margin of a proposed range of hues, and least half of its width [deg]: at other places the light differs."""


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

    def proposed(self, dlo: UInt8Array) -> "ColourConfig | None":
        """Settings that find the pixels `dlo` (N, 3), RGB: their middle hue and their spread; None if they are grey."""
        hue_deg, saturation, value = _hsv(dlo[None])[0].astype(np.float64).T * [[2.0], [1.0], [1.0]]
        if np.median(saturation * value) < 255.0 * _LEAST_COLOURED:
            return None
        # Hues are a circle, and those of grey pixels mean nothing: directions, weighted by the saturation.
        middle = np.angle(np.sum(saturation * np.exp(1j * np.radians(hue_deg))), deg=True)
        off = (hue_deg - middle + 180.0) % 360.0 - 180.0
        half = float(np.clip(np.percentile(np.abs(off), _MOST) + _HUE_MARGIN_DEG, _LEAST_HALF_DEG, 90.0))
        return replace(
            self,
            lowest_hue_deg=float(round((middle - half) % 360.0)),
            highest_hue_deg=float(round((middle + half) % 360.0)),
            least_saturation=max(int(np.percentile(saturation, 100.0 - _MOST)) - _MARGIN, _LEAST_SATURATION),
            least_value=max(int(np.percentile(value, 100.0 - _MOST)) - _MARGIN, 0),
        )


def _hsv(pixels: UInt8Array) -> UInt8Array:
    """Hue [2°], saturation and value of pixels (height, width, 3), RGB."""
    # Here, because every process loads the settings, and only one process segments pictures.
    import cv2

    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV), dtype=np.uint8)


class Colour:
    """Which pixels have the colour."""

    def __init__(self, config: ColourConfig) -> None:
        self._config = config

    def mask(self, image: Image) -> Mask:
        """Pixels within the range of hues, coloured and light enough. A grey picture has no such pixels."""
        if image.pixels.ndim == 2:
            return Mask(pixels=np.zeros(image.pixels.shape, dtype=np.bool_))
        hsv = _hsv(image.pixels)
        # OpenCV counts hues in steps of two degrees, so that they fit a byte.
        low, high = round(self._config.lowest_hue_deg / 2), round(self._config.highest_hue_deg / 2)
        hue = hsv[..., 0]
        in_hue = (hue >= low) & (hue <= high) if low <= high else (hue >= low) | (hue <= high)
        vivid = (hsv[..., 1] >= self._config.least_saturation) & (hsv[..., 2] >= self._config.least_value)
        return Mask(pixels=in_hue & vivid)
