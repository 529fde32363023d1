"""Settings that every action strategy shares: how to grasp, how to carry, what is feasible."""

from dataclasses import dataclass, field

from dlokit.description.arm.panda import PANDA_GRASP_HEIGHT_M
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ConfigError
from dlokit.types.action import VelocityProfile

_TABLE_SLACK_M = 0.03  # a shape may lie a little outside of where the built-in ones do
_PACE = VelocityProfile()


@dataclass(frozen=True, kw_only=True)
class GraspConfig:
    """Where the gripper takes hold."""

    height_m: float = PANDA_GRASP_HEIGHT_M
    """Height of the tool centre point over the table at grasp and release [m]. Larger: the fingertips stay farther from
    the table, and hold less of a thin DLO."""


@dataclass(frozen=True, kw_only=True)
class PathConfig:
    """How the grasped node is carried to its goal."""

    lift_m: float = 0.04
    """Height of the carry above the grasp [m]. Larger: less of the DLO drags over the table. `rollout` begins with it
    and tries others."""
    speed_m_s: float = _PACE.speed_m_s
    """Speed of the tool on the carry [m/s]. Larger: shorter actions. `rollout` begins with it and tries others."""
    acceleration_m_s2: float = _PACE.acceleration_m_s2
    """Largest acceleration of the tool on the carry [m/s²]. Larger: shorter actions, and a DLO that swings more."""
    jerk_m_s3: float = _PACE.jerk_m_s3
    """Largest jerk of the tool on the carry [m/s³]. Larger: the acceleration sets in more abruptly."""


@dataclass(frozen=True, kw_only=True)
class FeasibilityConfig:
    """What a start or goal shape must keep to."""

    table_x_m: tuple[float, float] = (TABLE_X_M[0] - _TABLE_SLACK_M, TABLE_X_M[1] + _TABLE_SLACK_M)
    """Usable table along x [m]."""
    table_y_m: tuple[float, float] = (TABLE_Y_M[0] - _TABLE_SLACK_M, TABLE_Y_M[1] + _TABLE_SLACK_M)
    """Usable table along y [m]."""
    view_margin_px: float = 4.0
    """A node must be this far inside the picture [px]."""
    min_bend_radius_m: float = 0.008
    """Tightest bend of a goal [m]."""
    length_tolerance: float = 0.02
    """A goal may be this share longer or shorter than the rod."""
    handled_from_m: float = 0.05
    """A node of a goal that cannot be grasped is no harm when one this near along the rod can be [m]."""
    hold_share: float = 0.5
    """A goal holds when the rod, released there, springs back by no more than this share of the threshold."""
    doubt_sds: float = 2.0
    """What the DLO may be: so many standard deviations of what is believed of EI / (μ w), to either side."""
    yield_doubt: float = 1.5
    """Factor by which the curvature where the DLO yields may be other than believed."""
    set_doubt: float = 0.05
    """A goal can be hopeless for springing back where the chance that the DLO keeps bends is no more than this."""
    hopeless_factor: float = 1.1
    """A goal is hopeless when even at best no shape holds that is within this many thresholds of it."""
    nearest_shares: tuple[float, ...] = (0.75, 0.5, 0.35)
    """Shares of friction with which the nearest shape that holds is sought, until one holds in every trial."""

    def __post_init__(self) -> None:
        if not 0.0 < self.hold_share <= 1.0:
            raise ConfigError(f"--planning.feasibility.hold-share is {self.hold_share}; it must be above 0, at most 1.")
        if not self.doubt_sds >= 0.0:
            raise ConfigError(f"--planning.feasibility.doubt-sds is {self.doubt_sds}; it must be 0 (no doubt) or more.")
        if not self.yield_doubt >= 1.0:
            raise ConfigError(
                f"--planning.feasibility.yield-doubt is {self.yield_doubt}; it must be 1 (no doubt) or more."
            )
        if not all(0.0 < share <= 1.0 for share in self.nearest_shares):
            raise ConfigError(
                f"--planning.feasibility.nearest-shares are {self.nearest_shares}; each must be above 0, at most 1."
            )


@dataclass(frozen=True, kw_only=True)
class ActionConfig:
    """How any pick-and-place action is made."""

    grasp: GraspConfig = field(default_factory=GraspConfig)
    """Where the gripper takes hold."""
    path: PathConfig = field(default_factory=PathConfig)
    """How the grasped node is carried."""
