"""Settings of the segmentation by colour."""

from dataclasses import dataclass
from typing import ClassVar

from dlokit.skills.perception.base import Segmentation


@dataclass(frozen=True, kw_only=True)
class ColourConfig:
    """By colour, in hue, saturation and value: for a coloured DLO, whatever the brightness around it."""

    name: ClassVar[str] = "colour"

    lowest_hue_deg: float = 30.0
    """Where the range of hues begins [deg], 0 to 360: 0 red, 60 yellow, 120 green, 240 blue."""
    highest_hue_deg: float = 75.0
    """Where the range of hues ends [deg]; below the begin, it passes through red."""
    least_saturation: int = 80
    """0 (grey) to 255 (pure colour)."""
    least_value: int = 80
    """0 (black) to 255."""

    def __post_init__(self) -> None:
        hues = (self.lowest_hue_deg, self.highest_hue_deg)
        if not all(0.0 <= hue <= 360.0 for hue in hues):
            raise ValueError(f"hues {hues[0]:g} to {hues[1]:g} deg: each must lie between 0 and 360 deg")
        if not all(0 <= least <= 255 for least in (self.least_saturation, self.least_value)):
            raise ValueError("least_saturation and least_value must lie between 0 and 255")

    def build(self) -> Segmentation:
        """The filter with these settings."""
        # Here, because every process loads the settings, and only one of them needs what they build.
        from dlokit.skills.perception.colour import Colour

        return Colour(self)
