"""Settings common to all action strategies: grasping, carrying, feasibility."""

from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from dlokit.description.arm.model import TIP_CLEARANCE_M
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.ranges import NotNegative, Positive, check_ranges
from dlokit.types.action import VelocityProfile

_TABLE_SLACK_M = 0.03  # margin around the area of the built-in shapes
_PACE = VelocityProfile()


@dataclass(frozen=True, kw_only=True)
class GraspConfig:
    """Where the gripper takes hold."""

    tip_clearance_m: NotNegative = TIP_CLEARANCE_M
    """Distance of the fingertips from the table at grasp and release [m]. Larger: the fingertips hold less of a thin
    DLO."""

    def __post_init__(self) -> None:
        check_ranges(self, "planning.actions.grasp")


@dataclass(frozen=True, kw_only=True)
class PathConfig:
    """Carrying the grasped node to its goal."""

    lift_m: NotNegative = 0.04
    """Height of the carry above the grasp [m]. Larger: less of the DLO drags over the table. `rollout` begins with it
    and tries others."""
    speed_m_s: Positive = _PACE.speed_m_s
    """Speed of the tool on the carry [m/s]. Larger: shorter actions. `rollout` begins with it and tries others."""
    acceleration_m_s2: Positive = _PACE.acceleration_m_s2
    """Largest acceleration of the tool on the carry [m/s²]. Larger: shorter actions, and a DLO that swings more."""
    jerk_m_s3: Positive = _PACE.jerk_m_s3
    """Largest jerk of the tool on the carry [m/s³]. Larger: the acceleration sets in more abruptly."""

    def __post_init__(self) -> None:
        check_ranges(self, "planning.actions.path")

    def velocity(self, speed_m_s: float) -> VelocityProfile:
        """How fast the tool moves along a path at another speed [m/s]."""
        return VelocityProfile(speed_m_s=speed_m_s, acceleration_m_s2=self.acceleration_m_s2, jerk_m_s3=self.jerk_m_s3)


@dataclass(frozen=True, kw_only=True)
class FeasibilityConfig:
    """Limits of start and goal shapes."""

    table_x_m: tuple[float, float] = (TABLE_X_M[0] - _TABLE_SLACK_M, TABLE_X_M[1] + _TABLE_SLACK_M)
    """Usable table along x, from and to [m]: shapes outside are rejected, actions that lead there avoided."""
    table_y_m: tuple[float, float] = (TABLE_Y_M[0] - _TABLE_SLACK_M, TABLE_Y_M[1] + _TABLE_SLACK_M)
    """Usable table along y, from and to [m]."""
    min_bend_radius_m: NotNegative = 0.008
    """Radius of the tightest bend that a goal may have [m]. Larger: more goals are doubtful."""
    hold_fraction: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.5
    """A goal holds when the released DLO springs back by no more than this fraction of the threshold, above 0 and
    at most 1. Larger: fewer goals are doubtful."""

    def __post_init__(self) -> None:
        check_ranges(self, "planning.feasibility")


@dataclass(frozen=True, kw_only=True)
class ActionConfig:
    """How any pick-and-place action is made."""

    grasp: GraspConfig = field(default_factory=GraspConfig)
    """Where the gripper takes hold."""
    path: PathConfig = field(default_factory=PathConfig)
    """How the grasped node is carried."""
