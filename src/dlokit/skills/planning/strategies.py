"""The action strategies: those of dlokit, and external ones through the entry points ``dlokit.planners``.

Every process imports them for their settings; compiled code is loaded before the first decision.
"""

from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.rod import rollout
from dlokit.skills.planning.base import Loaded, StrategyConfig
from dlokit.skills.planning.farthest import FarthestConfig, FarthestTangentConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig

OURS: tuple[type[StrategyConfig], ...] = (FarthestConfig, FarthestTangentConfig, RolloutConfig)
"""Strategies that ship with dlokit, the paper's first."""

PLANNERS: StrategyKind[StrategyConfig] = StrategyKind("action strategy", "dlokit.planners", OURS)

Planner = Annotated[StrategyConfig, PLANNERS, tyro.conf.arg(constructor_factory=PLANNERS.union)]
"""The settings of any installed action strategy: a choice on the command line and in configuration files."""

strategies = PLANNERS.installed
to_spec = PLANNERS.to_spec
from_spec = PLANNERS.from_spec


def load(strategy: StrategyConfig) -> None:
    """Compile or load the rod for goal verdicts, and the code of the strategy."""
    rollout.load_kernels()
    if isinstance(strategy, Loaded):
        strategy.load()
