"""The action strategies there are: ours, and third parties' through the entry points ``dlokit.planners``."""

from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.farthest_config import FarthestConfig, FarthestTangentConfig
from dlokit.skills.planning.rollout.config import RolloutConfig

OURS: tuple[type[StrategyConfig], ...] = (FarthestConfig, FarthestTangentConfig, RolloutConfig)
"""Strategies that ship with dlokit, the paper's first."""

PLANNERS: StrategyKind[StrategyConfig] = StrategyKind("action strategy", "dlokit.planners", OURS)

Planner = Annotated[StrategyConfig, PLANNERS, tyro.conf.arg(constructor_factory=PLANNERS.union)]
"""The settings of any installed action strategy: a choice on the command line and in configuration files."""

strategies = PLANNERS.installed
to_spec = PLANNERS.to_spec
from_spec = PLANNERS.from_spec
