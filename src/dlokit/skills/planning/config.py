"""The planners to choose from, dlokit's and those of the entry points ``dlokit.planners``, and settings of planning."""

from dataclasses import dataclass, field
from typing import Annotated

import tyro

from dlokit.communication.strategies import StrategyKind
from dlokit.rod import rollout
from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.base import Loaded, StrategyConfig
from dlokit.skills.planning.farthest import FarthestConfig, FarthestTangentConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.servoing import ServoConfig

OURS: tuple[type[StrategyConfig], ...] = (FarthestConfig, FarthestTangentConfig, RolloutConfig)
"""Strategies that ship with dlokit, the paper's first."""

PLANNERS: StrategyKind[StrategyConfig] = StrategyKind("action strategy", "dlokit.planners", OURS)

Planner = Annotated[StrategyConfig, PLANNERS, tyro.conf.arg(constructor_factory=PLANNERS.union)]
"""The settings of any installed action strategy: a choice on the command line and in configuration files."""

strategies = PLANNERS.installed
to_spec = PLANNERS.to_spec
from_spec = PLANNERS.from_spec


@dataclass(frozen=True, kw_only=True)
class ForesightConfig:
    """Avoidance of actions that would tangle the rod."""

    enabled: bool = True
    """Skip actions after which the model predicts strands of the DLO closer than 4 cm. False, as in the paper: take
    the first action that the strategy proposes."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """How actions are chosen."""

    strategy: Planner = field(default_factory=RolloutConfig)
    """Which action strategy."""
    actions: ActionConfig = field(default_factory=ActionConfig)
    """Grasping and carrying, for all strategies."""
    foresight: ForesightConfig = field(default_factory=ForesightConfig)
    """Avoidance of tangles."""
    feasibility: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    """What start and goal must keep to."""
    servo: ServoConfig = field(default_factory=ServoConfig)
    """Shape servoing: reduction of the remaining error while the DLO is held."""


def load(strategy: StrategyConfig) -> None:
    """Compile or load the rod for goal verdicts, and the code of the strategy."""
    rollout.load_kernels()
    if isinstance(strategy, Loaded):
        strategy.load()
