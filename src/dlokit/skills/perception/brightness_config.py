"""Settings of the segmentation by brightness."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.perception.base import Segmentation


@dataclass(frozen=True, kw_only=True)
class BrightnessConfig:
    """By brightness, as in the paper: for a light DLO on a dark table."""

    name: ClassVar[str] = "brightness"

    lowest: int = 120
    """Least brightness of the DLO, 0 to 255."""
    highest: int = 255
    """Greatest brightness of the DLO, 0 to 255."""

    def __post_init__(self) -> None:
        if not 0 <= self.lowest <= self.highest <= 255:
            raise ValueError(
                f"brightness from {self.lowest} to {self.highest}: 0 <= lowest <= highest <= 255 is allowed"
            )

    def build(self) -> Segmentation:
        """The filter with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.perception.brightness import Brightness

        return Brightness(self)
