"""The installed cameras: dlokit's, and those that annexes and other packages add by entry points `dlokit.cameras`."""

from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.functional.cameras.base import CameraConfig
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.simulated import SimulatedD435Config, SimulatedStereoConfig

OURS: tuple[type[CameraConfig], ...] = (SimulatedStereoConfig, SimulatedD435Config, RecordedCameraConfig)
"""Cameras that need no device, the default first; the one place where they are named."""

CAMERAS: StrategyKind[CameraConfig] = StrategyKind("camera", "dlokit.cameras", OURS)

AnyCamera = Annotated[CameraConfig, CAMERAS, tyro.conf.arg(constructor_factory=CAMERAS.union)]
"""The settings of any installed camera: a choice on the command line and in configuration files."""
