"""Settings of planning."""

from dataclasses import dataclass, field

from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.servoing import ServoConfig
from dlokit.skills.planning.strategies import Planner


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
