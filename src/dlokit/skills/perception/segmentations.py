"""The segmentations there are: ours, and third parties' through the entry points ``dlokit.segmentations``."""

from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig

OURS: tuple[type[SegmentationConfig], ...] = (BrightnessConfig, ColourConfig)
"""Strategies that ship with dlokit, the paper's first."""

SEGMENTATIONS: StrategyKind[SegmentationConfig] = StrategyKind("segmentation", "dlokit.segmentations", OURS)

AnySegmentation = Annotated[SegmentationConfig, SEGMENTATIONS, tyro.conf.arg(constructor_factory=SEGMENTATIONS.union)]
"""The settings of any installed segmentation: a choice on the command line and in configuration files."""

to_spec = SEGMENTATIONS.to_spec
from_spec = SEGMENTATIONS.from_spec
