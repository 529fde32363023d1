"""Settings of planning."""

from dataclasses import dataclass, field

from dlokit.skills.planning.actions import ActionConfig, FeasibilityConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.servoing.jacobian import ServoConfig
from dlokit.skills.planning.strategies import Planner


@dataclass(frozen=True, kw_only=True)
class ForesightConfig:
    """How far strands of the rod must stay apart."""

    enabled: bool = True
    """Off as in the paper: the farthest node is taken whatever becomes of the rest."""
    clearance_m: float = 0.04
    """Strands that are no neighbours on the rod stay this far apart after an action, as predicted [m]."""
    goal_share: float = 0.7
    """A goal whose strands are closer asks for no more than this share of its own clearance."""
    node_stride: int = 3
    """After a tangle, the next node tried is at least this far from it: neighbours fare alike."""
    max_predictions: int = 8
    """Actions played through, at most; then the one that keeps the strands farthest apart is taken."""


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
