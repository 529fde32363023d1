"""The paper's filter: what is bright is DLO."""

import cv2
import numpy as np

from dlokit.skills.perception.brightness_config import BrightnessConfig
from dlokit.skills.perception.rectification import grey
from dlokit.types.image import Image, Mask


class Brightness:
    """Which pixels are bright enough."""

    def __init__(self, config: BrightnessConfig) -> None:
        self._config = config

    def mask(self, image: Image) -> Mask:
        """Pixels within the range of brightness."""
        inside = cv2.inRange(grey(image.pixels), self._config.lowest, self._config.highest)  # pyright: ignore[reportCallIssue, reportArgumentType]  # scalars are allowed bounds
        return Mask(pixels=np.asarray(inside, dtype=np.uint8) > 0)
