"""The skills of the robot.

Every motion is checked before it runs. In addition to the failures named at each skill, a motion fails with:
joint_limit, velocity_limit, acceleration_limit, jerk_limit, table_collision, self_collision, fixture_collision (of the
fingers while they move too), arms_too_near (also during the motion), neighbour_silent, stopped, lease_lost, robot_lost,
lost_commander, fault (call recover), reflex (the arm stopped itself because set-points came late), tracking (it was too
far from its set-points), collision, user_stop (both need a person); at the gate before the driver with: bad_trajectory,
outside_workspace, tool_speed, stale_feedback, wrong_start; and is rejected with: busy (another motion runs),
not_commander (another holds the lease), lease_lost (the lease has expired), stop_latched (a person has stopped the arm,
and none has enabled it since), no_operator (the arm is real, and no operator has confirmed the start). Cancelling a
motion brakes the arm.
"""

import math
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numpy as np

from dlokit.communication.skill import Condition, Skill
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import LEASE_S, GripResult, MotionResult, RobotReason

P = ParamSpec("P")
R = TypeVar("R")

LONGEST_LEASE_S = 60.0
"""Longest lease without renewal [s]; the arm may keep moving for this long after its commander is lost."""

GRASP_FORCE_N = 20.0
"""Default force of the fingers [N]."""
RELEASE_WIDTH_M = 0.04
"""Default width to which the fingers open [m]."""


def _move_joints(q_rad: Float64Array) -> MotionResult:
    """Move on a straight line in joint space to joint angles (J,) [rad], as fast as the limits allow."""
    ...


def _move_to(target: Pose, either_way: bool = True) -> MotionResult:
    """Move in joint space to a tool pose ``T_world_tcp``, as fast as the limits allow; the tool's path is not straight.

    The gripper is symmetric: with `either_way` it may end half a turn about its own z axis away from the pose, if the
    arm does not reach the pose as given. Fails with: unreachable.
    """
    ...


def _move_linear(target: Pose, velocity: VelocityProfile) -> MotionResult:
    """Move the tool on a straight line to a pose ``T_world_tcp``, or to the same turned by half a turn if nearer.

    Slower than `velocity` where the joints require it. Fails with: unreachable (a pose on the line), too_slow (the
    motion would take longer than the skill may).
    """
    ...


def _follow_path(path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
    """Move the tool on straight lines through poses ``T_world_tcp``, rounding corners by up to 5 cm before and after.

    The tool stops at the last pose, and where the path turns back. All poses are turned by half a turn when that brings
    the first nearer. Fails with: unreachable (a pose on the path), too_slow (the motion would take longer than 120 s).
    """
    ...


def _grasp(force_n: float = GRASP_FORCE_N) -> GripResult:
    """Close the fingers with at most `force_n`; the result reports whether they hold something.

    Fails with: bad_force (more than the hand can), gripper_jammed.
    """
    ...


def _release(width_m: float = RELEASE_WIDTH_M) -> GripResult:
    """Open the fingers to `width_m`.

    Rejected with: bad_width (below 0). Fails with: bad_width (more than they open), gripper_jammed.
    """
    ...


def _halt() -> None:
    """Brake now; the running motion fails with ``stopped``, and the next may begin at once."""
    ...


def _stop() -> None:
    """Brake now and hold the fingers; the running motion fails with ``stopped``, and nothing moves until `enable`.

    A person's stop; any caller may use it. It returns when the arm is at rest, and outlasts task, lease and commander.
    Fails with: not_confirmed (no feedback confirms that the arm is at rest and the stop is latched).
    """
    ...


def _enable() -> None:
    """Clear a person's stop, at the request of a person who has checked that the arm may move.

    Fails with: not_confirmed (no feedback confirms that the stop is cleared).
    """
    ...


def _recover() -> None:
    """Clear a fault of the arm; it stays where it is. Rejected with: not_commander, stop_latched."""
    ...


def _home() -> MotionResult:
    """Move in joint space to the pose in which the arm occludes no part of the table."""
    ...


def _renew_lease(holder: str, duration_s: float = LEASE_S) -> None:
    """Take or renew the lease on the robot: from now on the arm brakes when no renewal arrives in time.

    `duration_s` counts on the machine's monotonic clock. Rejected with: leased (another holds it), bad_lease,
    not_commander (`holder` is not the caller).
    """
    ...


def _release_lease(holder: str) -> None:
    """Return the lease; the arm no longer expects renewals.

    Rejected with: leased (another holds it), not_commander (`holder` is not the caller).
    """
    ...


def _confirm_start() -> None:
    """Allow the caller to move a real arm: an operator has answered the questions of the start.

    Valid until the lease is returned or changes hands. Only the holder of the lease may call it; an arm in software or
    in the simulated cell does not need it. Rejected with: not_commander.
    """
    ...


HOLDER = Condition("the caller holds the lease", RobotReason.NOT_COMMANDER)
CONFIRMED = Condition(
    "an operator has confirmed the start to the holder of the lease, if the arm is real", RobotReason.NO_OPERATOR
)
COMMANDER = Condition("the caller holds the lease, or there is no holder", RobotReason.NOT_COMMANDER)
OWN_NAME = Condition("holder names the caller", RobotReason.NOT_COMMANDER)
LEASE = Condition("the lease has not expired, if there is one", RobotReason.LEASE_LOST)
ENABLED = Condition("no person has stopped the arm since it was last enabled", RobotReason.STOP_LATCHED)
_ANGLES = Condition("q_rad is a row of finite angles", "bad_arguments", lambda q_rad: _is_row(q_rad))
_WIDTH = Condition("width_m is at least 0", RobotReason.BAD_WIDTH, lambda width_m: 0.0 <= width_m < math.inf)
_FORCE = Condition("force_n is above 0", RobotReason.BAD_FORCE, lambda force_n: 0.0 < force_n < math.inf)
_DURATION = Condition(
    f"duration_s is above 0 and at most {LONGEST_LEASE_S:g}",
    RobotReason.BAD_LEASE,
    lambda duration_s: 0.0 < duration_s <= LONGEST_LEASE_S,
)


def _is_row(q_rad: Float64Array) -> bool:
    return q_rad.ndim == 1 and bool(np.isfinite(q_rad).all())


def _motion(name: str, signature: Callable[P, R], timeout_s: float, ensures: str, *requires: Condition) -> Skill[P, R]:
    """A skill that moves the arm: one at a time, and only for its commander."""
    return Skill(
        "robot",
        name,
        signature,
        timeout_s,
        requires=(*requires, ENABLED, COMMANDER, CONFIRMED),
        ensures=ensures,
        keeps=(LEASE,),
        exclusive="motion",
        moves_arm=True,
    )


# Longer than any motion that the gate accepts. A joint motion takes 50 s at most, at the smallest speed scale (0.05).
MOVE_JOINTS = _motion("move_joints", _move_joints, 60.0, "the arm is at rest at the angles", _ANGLES)
MOVE_TO = _motion("move_to", _move_to, 60.0, "the arm is at rest with the tool at the pose")
MOVE_LINEAR = _motion("move_linear", _move_linear, 240.0, "the arm is at rest with the tool at the pose")
FOLLOW_PATH = _motion("follow_path", _follow_path, 240.0, "the arm is at rest with the tool at the last pose")
GRASP = _motion("grasp", _grasp, 10.0, "the fingers are at rest", _FORCE)
RELEASE = _motion("release", _release, 10.0, "the fingers are open and at rest", _WIDTH)
HALT = Skill("robot", "halt", _halt, 5.0, "", "the arm is at rest")
STOP = Skill("robot", "stop", _stop, 5.0, "", "arm and fingers are at rest, and nothing moves them before enable")
ENABLE = Skill("robot", "enable", _enable, 5.0, "", "the arm may be moved")
RECOVER = Skill("robot", "recover", _recover, 5.0, (ENABLED, COMMANDER), "the arm is idle")
HOME = _motion("home", _home, 60.0, "the arm is at rest at home")
RENEW_LEASE = Skill(
    "robot", "renew_lease", _renew_lease, 1.0, (_DURATION, OWN_NAME), "the arm brakes without a further renewal"
)
RELEASE_LEASE = Skill("robot", "release_lease", _release_lease, 1.0, (OWN_NAME,), "no renewals are expected")
CONFIRM_START = Skill("robot", "confirm_start", _confirm_start, 1.0, (HOLDER,), "the caller may move the arm")
