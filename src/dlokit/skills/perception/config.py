"""Perception's settings, and the installed segmentations: dlokit's and the entry points ``dlokit.segmentations``."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig

Point = tuple[float, float, float]


OURS: tuple[type[SegmentationConfig], ...] = (BrightnessConfig, ColourConfig)
"""Strategies that dlokit includes, the paper's first."""

SEGMENTATIONS: StrategyKind[SegmentationConfig] = StrategyKind("segmentation", "dlokit.segmentations", OURS)

AnySegmentation = Annotated[SegmentationConfig, SEGMENTATIONS, tyro.conf.arg(constructor_factory=SEGMENTATIONS.union)]
"""The settings of any installed segmentation: a choice on the command line and in configuration files."""

to_spec = SEGMENTATIONS.to_spec
from_spec = SEGMENTATIONS.from_spec


@dataclass(frozen=True, kw_only=True)
class BoxConfig:
    """The part of the world in which the DLO may be."""

    lower_world: Point = (0.20, -0.50, -0.02)
    """Corner with the smallest coordinates [m]."""
    upper_world: Point = (0.95, 0.45, 0.25)
    """Corner with the largest coordinates [m]."""

    def __post_init__(self) -> None:
        lower, upper = np.array(self.lower_world), np.array(self.upper_world)
        if lower.shape != (3,) or upper.shape != (3,) or not np.all(lower < upper):
            raise ValueError(
                f"box from {self.lower_world} to {self.upper_world} m: each coordinate of lower_world must be smaller "
                "than that of upper_world"
            )


@dataclass(frozen=True, kw_only=True)
class StereoConfig:
    """Semi-global matching."""

    block_px: int = 5
    """Side of the matched block [px], odd; about the width of the DLO in the picture. Larger: less noise, and thin DLOs
    vanish."""
    highest_m: float = 0.25
    """Greatest height above the table that is searched [m]. Larger: a higher DLO is seen, and matching is
    slower."""


@dataclass(frozen=True, kw_only=True)
class CloudConfig:
    """From disparities to the cloud."""

    voxel_m: float = 0.004
    """Side of the cubes that each keep the mean of their points [m]; 0 keeps all points. Larger: smaller clouds."""


@dataclass(frozen=True, kw_only=True)
class TableConfig:
    """Use of the table: it corrects the camera's pose, and nothing is below its top."""

    supports: bool = True
    """Whether the DLO cannot be below the table's top; turn it off for a DLO that may hang over the edge."""
    correct_pose: bool = True
    """Whether to correct the assumed camera pose by the table, which must have texture and be level."""


@dataclass(frozen=True, kw_only=True)
class PerceptionConfig:
    """From pictures to the DLO's points."""

    segmentation: AnySegmentation = field(default_factory=BrightnessConfig)
    """Which pixels are DLO."""
    box: BoxConfig = field(default_factory=BoxConfig)
    """Where in the world the DLO may be."""
    stereo: StereoConfig = field(default_factory=StereoConfig)
    """Matching of the two pictures of a stereo camera."""
    cloud: CloudConfig = field(default_factory=CloudConfig)
    """From disparities to the cloud."""
    table: TableConfig = field(default_factory=TableConfig)
    """Use of the table."""
    smallest_patch_px: int = 20
    """Smallest patch of DLO pixels that is used [px]; smaller ones are noise. Larger: less noise, and short visible
    pieces vanish."""
    capture_timeout_s: float = 1.7
    """Time after which a camera that gives no pictures counts as lost [s]: named within 2 s."""
    tracking_rate_hz: float = 0.0
    """Looks per second while tracking, until changed by a skill call; 0: only on demand."""
