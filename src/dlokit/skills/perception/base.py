"""The protocol of segmentation strategies, which find the DLO's pixels."""

from typing import ClassVar, Protocol, Self, runtime_checkable

from dlokit.types.arrays import UInt8Array
from dlokit.types.image import Image, Mask


class Segmentation(Protocol):
    """A method that finds the DLO's pixels in a picture."""

    def mask(self, image: Image) -> Mask:
        """The DLO's pixels in `image` (RGB or grey). Pure; later steps of perception remove the robot's pixels."""
        ...


class SegmentationConfig(Protocol):
    """The settings of a strategy: a frozen dataclass, all fields with defaults, with a method that builds it.

    Every process loads it and its module, so large libraries are imported in the methods that call them.
    """

    name: ClassVar[str]

    def build(self) -> Segmentation:
        """The strategy with these settings."""
        ...


@runtime_checkable
class ProposesSettings(Protocol):
    """Settings that can be found from pixels of the DLO: a method that a `SegmentationConfig` may also have."""

    def proposed(self, dlo: UInt8Array) -> Self | None:
        """These settings, changed so that they find the pixels `dlo` (N, 3), RGB, of one clicked DLO.

        None: they cannot, as a colour cannot be told of a grey DLO.
        """
        ...
