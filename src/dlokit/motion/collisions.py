"""What a trajectory must satisfy before it runs: joint limits, the table, the robot itself. Pure.

A failure is a `SkillFailure` with a `RobotReason`; it says what was wrong, what is allowed, what to do.
"""

import numpy as np

from dlokit.description.arm.panda import PANDA_COLLISION, PANDA_LIMITS
from dlokit.description.table import TABLE_TOP_M
from dlokit.errors import SkillFailure
from dlokit.motion.capsules import RADII_M, Capsules, capsule_distances
from dlokit.motion.forward_kinematics import capsule_ends
from dlokit.motion.limits import limit_violation
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointLimits, JointTrajectory, RobotReason

TABLE_CLEARANCE_M = 0.001
"""Smallest distance of any part of the arm from the table [m]; fingertips grasp 2 mm above it."""
COLLISION_STEP_RAD = 0.03
"""Largest joint angle between two configurations that are checked for collisions [rad]: the hand moves by less than
3 cm."""
_GRIPPER = ("hand", "left_finger", "right_finger")
# Pairs of links that can meet within the joint limits; neighbours overlap at their joint and cannot.
_PAIRS = (
    *((low, high) for low in ("link0", "link1", "link2") for high in ("link5", "link6", "link7", *_GRIPPER)),
    *(("link3", high) for high in ("link7", *_GRIPPER)),
    *(("link4", high) for high in ("link7", *_GRIPPER)),
    *(("link5", high) for high in _GRIPPER),
)
_LINKS = [capsule.link for capsule in PANDA_COLLISION]
_FIRST, _SECOND = (
    np.array(column)
    for column in zip(
        *(
            (i, j)
            for a, b in _PAIRS
            for i, first in enumerate(_LINKS)
            for j, second in enumerate(_LINKS)
            if first == a and second == b
        ),
        strict=True,
    )
)
_ABOVE_TABLE = np.array([link not in ("link0", "link1") for link in _LINKS])  # those two cannot come down to it


def check_limits(trajectory: JointTrajectory, limits: JointLimits = PANDA_LIMITS) -> None:
    """Hold a trajectory, also by its own differences, to the limits of position, velocity, acceleration and jerk."""
    broken = limit_violation(trajectory, limits)
    if broken is not None:
        raise SkillFailure(broken.reason, broken.detail)


def check_collisions(q_rad: Float64Array, T_world_base: Pose | None = None) -> None:
    """Hold configurations (K, 7) [rad] clear of the table and of the arm itself."""
    start, end = capsule_ends(q_rad, T_world_base=T_world_base)
    _check_table(start, end)
    first, second = (Capsules(start[:, parts], end[:, parts], RADII_M[parts]) for parts in (_FIRST, _SECOND))
    gap = capsule_distances(first, second)  # the capsules themselves stand off the surface
    if np.any(gap < 0.0):
        _, pair = np.unravel_index(int(np.argmin(gap)), gap.shape)
        raise SkillFailure(
            RobotReason.SELF_COLLISION,
            f"{_LINKS[_FIRST[pair]]} and {_LINKS[_SECOND[pair]]} would come within {-gap.min() * 1e3:.0f} mm of "
            "less than they may; go by way of another posture, e.g. home",
        )


def _check_table(start: Float64Array, end: Float64Array) -> None:
    lowest = np.minimum(start[..., 2], end[..., 2]) - RADII_M - TABLE_TOP_M
    lowest = np.where(_ABOVE_TABLE, lowest, np.inf)
    if np.any(lowest < TABLE_CLEARANCE_M):
        _, part = np.unravel_index(int(np.argmin(lowest)), lowest.shape)
        raise SkillFailure(
            RobotReason.TABLE_COLLISION,
            f"{_LINKS[part]} would come to {lowest.min() * 1e3:.1f} mm above the table, at least "
            f"{TABLE_CLEARANCE_M * 1e3:.1f} mm are allowed; raise the path (a gripper pointing down may bring "
            "its tool centre point to 11 mm)",
        )


def check_trajectory(
    trajectory: JointTrajectory,
    limits: JointLimits = PANDA_LIMITS,
    T_world_base: Pose | None = None,
) -> None:
    """Everything that a trajectory must satisfy before it runs. Raises `SkillFailure`."""
    check_limits(trajectory, limits)
    check_collisions(thinned(trajectory.q_rad, COLLISION_STEP_RAD), T_world_base)


def thinned(q: Float64Array, step_rad: float) -> Float64Array:
    """Rows of `q` (K, 7) [rad] about `step_rad` apart in their most moving joint, with the first and the last."""
    travelled = np.concatenate(([0.0], np.cumsum(np.max(np.abs(np.diff(q, axis=0)), axis=1))))
    marks = np.arange(0.0, travelled[-1], step_rad)
    rows = np.unique(np.concatenate((np.searchsorted(travelled, marks), [len(q) - 1])))
    return q[rows]
