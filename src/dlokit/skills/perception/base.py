"""What a segmentation strategy is: it says which pixels are DLO."""

from typing import ClassVar, Protocol

from dlokit.types.image import Image, Mask


class Segmentation(Protocol):
    """A method that finds the DLO's pixels in a picture."""

    def mask(self, image: Image) -> Mask:
        """The DLO's pixels in `image` (RGB or grey). Pure; the robot's own pixels are removed by others."""
        ...


class SegmentationConfig(Protocol):
    """The settings of a strategy: a frozen dataclass, all fields with defaults, that knows how to build it.

    Every process loads it and its module: large libraries are imported where they are called.
    """

    name: ClassVar[str]

    def build(self) -> Segmentation:
        """The strategy with these settings."""
        ...
