"""Settings of planning."""

from dataclasses import dataclass, field

from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.servoing.controller import ServoConfig
from dlokit.skills.planning.strategies import Planner


@dataclass(frozen=True, kw_only=True)
class ForesightConfig:
    """Whether actions that would bring strands of the rod together are passed over."""

    enabled: bool = True
    """Pass over actions after which the model expects strands of the DLO closer than 4 cm. False, as in the paper: the
    first action that the strategy proposes is taken, whatever becomes of the rest of the DLO."""


@dataclass(frozen=True, kw_only=True)
class PlanningConfig:
    """How actions are chosen."""

    strategy: Planner = field(default_factory=RolloutConfig)
    """Which action strategy."""
    actions: ActionConfig = field(default_factory=ActionConfig)
    """How to grasp and carry, whatever the strategy."""
    foresight: ForesightConfig = field(default_factory=ForesightConfig)
    """Actions that would tangle the rod are passed over."""
    feasibility: FeasibilityConfig = field(default_factory=FeasibilityConfig)
    """What start and goal must keep to."""
    servo: ServoConfig = field(default_factory=ServoConfig)
    """How the error that is left is reduced while the DLO is held."""
