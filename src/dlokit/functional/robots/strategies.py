"""The installed robot drivers: dlokit's, and drivers that packages add by the entry points `dlokit.robots`."""

from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.functional.robots.base import RobotDriverConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.functional.robots.simulated import SimulatedRobotConfig

OURS: tuple[type[RobotDriverConfig], ...] = (SimulatedRobotConfig, KinematicRobotConfig)
"""Drivers that need no device, the default first; the one place where they are named."""

DRIVERS: StrategyKind[RobotDriverConfig] = StrategyKind("robot driver", "dlokit.robots", OURS)

AnyRobotDriver = Annotated[RobotDriverConfig, DRIVERS, tyro.conf.arg(constructor_factory=DRIVERS.union)]
"""The settings of any installed robot driver: a choice on the command line and in configuration files."""
