"""The paper's filter, with its settings: bright pixels are DLO."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dlokit.errors import ConfigError
from dlokit.ranges import check_ranges
from dlokit.skills.perception.base import Segmentation
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import Image, Mask

GreyLevel = Annotated[int, Meta(ge=0, le=255)]

_MOST = 95.0
"""Percentage of the DLO's pixels that a proposal covers at each bound; the others are blurred edges."""
_MARGIN = 20.0
"""Margin of the proposed bounds: at other places the light differs."""
_DARK, _LIGHT = 85.0, 120.0
"""A DLO whose brightness is below or above is dark or light: pixels still darker, or lighter, are the DLO as well."""


@dataclass(frozen=True, kw_only=True)
class BrightnessConfig:
    """By brightness, as in the paper: for a light DLO on a dark table."""

    name: ClassVar[str] = "brightness"

    lowest: GreyLevel = 120
    """Least brightness of the DLO, 0 to 255."""
    highest: GreyLevel = 255
    """Greatest brightness of the DLO, 0 to 255."""

    def __post_init__(self) -> None:
        check_ranges(self, "perception.segmentation")
        if self.lowest > self.highest:
            raise ConfigError(
                f"--perception.segmentation.lowest is {self.lowest}; it must be at most highest ({self.highest})."
            )

    def build(self) -> Segmentation:
        """The filter with these settings."""
        return Brightness(self)

    def proposed(self, dlo: UInt8Array) -> "BrightnessConfig":
        """Settings that find the pixels `dlo` (N, 3), RGB. A very light or very dark DLO has one bound only."""
        from dlokit.skills.perception.rectification import grey

        brightness = grey(dlo[None])
        lowest = np.percentile(brightness, 100.0 - _MOST) - _MARGIN
        highest = np.percentile(brightness, _MOST) + _MARGIN
        return replace(
            self,
            lowest=0 if highest < _DARK else int(max(lowest, 0.0)),
            highest=255 if lowest > _LIGHT else int(min(highest, 255.0)),
        )


class Brightness:
    """Which pixels are bright enough."""

    def __init__(self, config: BrightnessConfig) -> None:
        self._config = config

    def mask(self, image: Image) -> Mask:
        """Pixels within the range of brightness."""
        # Here, because every process loads the settings, and only one process segments pictures.
        import cv2

        from dlokit.skills.perception.rectification import grey

        inside = cv2.inRange(grey(image.pixels), self._config.lowest, self._config.highest)  # pyright: ignore[reportCallIssue, reportArgumentType]  # scalars are allowed bounds
        return Mask(pixels=np.asarray(inside, dtype=np.uint8) > 0)
