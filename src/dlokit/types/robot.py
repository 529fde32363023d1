"""Robot state, limits, trajectories, and results of motions and grips."""

import enum
from typing import Self

import numpy as np

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import Pose

LEASE_S = 0.2
"""Default time without a heartbeat after which an arm brakes [s of machine time]."""
FIRST_ROBOT = "first"
"""Name of the arm at the world's origin."""


class Remedy(enum.Enum):
    """Remedies after a failed or rejected robot skill."""

    ANOTHER_TARGET = "another_target"
    """The target or the path to it is not possible; another target may be."""
    RECOVER = "recover"
    """The arm braked although nothing is broken, because a heartbeat or feedback arrived late on a busy machine: it can
    continue after `recover`."""
    NONE = "none"
    """Something is broken, the call was invalid, or a person stopped the arm."""


class RobotReason(enum.StrEnum):
    """Reasons of the robot's `Failed` and `Rejected` outcomes, each with its remedy."""

    remedy: Remedy

    def __new__(cls, value: str, remedy: Remedy) -> Self:
        """Make a reason; a declaration without a remedy raises an error."""
        reason = str.__new__(cls, value)
        reason._value_ = value
        reason.remedy = remedy
        return reason

    UNREACHABLE = "unreachable", Remedy.ANOTHER_TARGET
    JOINT_LIMIT = "joint_limit", Remedy.ANOTHER_TARGET
    VELOCITY_LIMIT = "velocity_limit", Remedy.ANOTHER_TARGET
    ACCELERATION_LIMIT = "acceleration_limit", Remedy.ANOTHER_TARGET
    JERK_LIMIT = "jerk_limit", Remedy.ANOTHER_TARGET
    TOO_SLOW = "too_slow", Remedy.ANOTHER_TARGET
    TABLE_COLLISION = "table_collision", Remedy.ANOTHER_TARGET
    FIXTURE_COLLISION = "fixture_collision", Remedy.ANOTHER_TARGET
    SELF_COLLISION = "self_collision", Remedy.ANOTHER_TARGET
    ARMS_TOO_NEAR = "arms_too_near", Remedy.ANOTHER_TARGET
    OUTSIDE_WORKSPACE = "outside_workspace", Remedy.ANOTHER_TARGET
    TOOL_SPEED = "tool_speed", Remedy.ANOTHER_TARGET

    LOST_COMMANDER = "lost_commander", Remedy.RECOVER
    LEASE_LOST = "lease_lost", Remedy.RECOVER
    STALE_FEEDBACK = "stale_feedback", Remedy.RECOVER
    NEIGHBOUR_SILENT = "neighbour_silent", Remedy.RECOVER
    REFLEX = "reflex", Remedy.RECOVER
    TRACKING = "tracking", Remedy.RECOVER

    BAD_TRAJECTORY = "bad_trajectory", Remedy.NONE
    WRONG_START = "wrong_start", Remedy.NONE
    BAD_WIDTH = "bad_width", Remedy.NONE
    BAD_FORCE = "bad_force", Remedy.NONE
    BAD_LEASE = "bad_lease", Remedy.NONE
    LEASED = "leased", Remedy.NONE
    NOT_COMMANDER = "not_commander", Remedy.NONE
    STOPPED = "stopped", Remedy.NONE
    STOP_LATCHED = "stop_latched", Remedy.NONE
    NOT_CONFIRMED = "not_confirmed", Remedy.NONE
    NO_OPERATOR = "no_operator", Remedy.NONE
    FAULT = "fault", Remedy.NONE
    COLLISION = "collision", Remedy.NONE
    USER_STOP = "user_stop", Remedy.NONE
    GRIPPER_JAMMED = "gripper_jammed", Remedy.NONE
    ROBOT_LOST = "robot_lost", Remedy.NONE


def remedy_of(reason: str) -> Remedy:
    """The remedy of an outcome's reason; `Remedy.NONE` for a reason that is not the robot's."""
    known = {each.value: each.remedy for each in RobotReason}
    return known.get(reason, Remedy.NONE)


class RobotMode(enum.Enum):
    """Present state of motion of the arm."""

    IDLE = "idle"
    MOVING = "moving"
    BRAKING = "braking"
    FAULT = "fault"
    """The arm stopped on its own (reflex, lost commander); it needs ``recover``."""


class SlowNearLimits(Value, frozen=True, kw_only=True, eq=False):
    """Velocity limits that fall towards the ends of the joints' ranges.

    A joint at q may move up with ``sqrt(2 deceleration (upper - q)) - offset``, not less than 0 and not more than its
    velocity limit; the limit downwards is symmetric, towards `lower_rad`. Source: libfranka, ``rate_limiting.h``.
    """

    lower_rad: Float64Array  # (J,) [rad]
    upper_rad: Float64Array  # (J,) [rad]
    deceleration_rad_s2: Float64Array  # (J,)
    offset_rad_s: Float64Array  # (J,)


class JointLimits(Value, frozen=True, kw_only=True, eq=False):
    """Limits of the joints; a trajectory that exceeds them is rejected before it runs."""

    position_lower_rad: Float64Array  # (J,) [rad]
    position_upper_rad: Float64Array  # (J,) [rad]
    velocity_rad_s: Float64Array  # (J,)
    acceleration_rad_s2: Float64Array  # (J,)
    jerk_rad_s3: Float64Array  # (J,)
    slow_near: SlowNearLimits | None = None
    """None: the velocity limits are the same at every angle."""

    def velocity_at(self, q_rad: Float64Array, direction: Float64Array) -> Float64Array:
        """Largest speed (…, J) [rad/s] of joints at `q_rad` (…, J) [rad] that move in the direction of a sign (…, J).

        If the velocity limits do not depend on the angle, the result is these limits (J,).
        """
        if self.slow_near is None:
            return self.velocity_rad_s
        near = self.slow_near
        left_rad = np.where(direction < 0.0, q_rad - near.lower_rad, near.upper_rad - q_rad)
        slow = np.sqrt(np.maximum(2.0 * near.deceleration_rad_s2 * left_rad, 0.0)) - near.offset_rad_s
        return np.clip(slow, 0.0, self.velocity_rad_s)


class RobotState(Message, frozen=True, kw_only=True, eq=False):
    """State of one robot at one time."""

    robot: str
    q_rad: Float64Array  # (J,)
    dq_rad_s: Float64Array  # (J,)
    tau_nm: Float64Array  # (J,) joint torques [N·m]
    T_world_tcp: Pose
    finger_width_m: float
    mode: RobotMode
    wrench_world: Float64Array | None = None  # (6,) external force [N] and torque [N·m] at the TCP
    holding: bool = False
    """Whether the fingers hold something (width and force agree)."""
    T_world_base: Pose | None = None
    """Pose of the arm's base; None: at the world's origin."""
    stop_latched: bool = False
    """Whether a person has stopped the arm: neither arm nor fingers move until a person enables it."""


class ArmProtection(Message, frozen=True, kw_only=True, eq=False):
    """Settings that a driver made on a real arm after connecting or recovering, with the values that it reports."""

    robot: str
    recovered: bool
    """Whether the settings were made after a recovery; else after connecting."""
    torque_nm: float
    """External torque of any joint at which the arm stops itself [N·m], as set."""
    force_n: float
    """External force on the tool at which the arm stops itself [N], as set."""
    load_kg: float
    """Mass of the load, as set [kg]."""
    load_at_m: Float64Array  # (3,) centre of the load in the flange's frame, as set [m]
    reported_load_kg: float
    """Mass of the load that the arm reports [kg]."""
    reported_tool_kg: float
    """Mass of the tool that the arm reports [kg]."""
    T_flange_tool: Pose
    """Frame of the tool that the arm reports."""


class JointTrajectory(Value, frozen=True, kw_only=True, eq=False):
    """A joint-space trajectory, sampled densely enough for linear interpolation of the velocity.

    Raises `BadValue` if the arrays differ in the number of samples or joints; `dlokit.motion.limits` checks the values.
    """

    times_s: Float64Array  # (K,) [s], increasing from 0
    q_rad: Float64Array  # (K, J)
    dq_rad_s: Float64Array  # (K, J)
    ddq_rad_s2: Float64Array  # (K, J)

    def __post_init__(self) -> None:
        times, q, dq, ddq = (array.shape for array in (self.times_s, self.q_rad, self.dq_rad_s, self.ddq_rad_s2))
        if len(times) != 1 or len(q) != 2 or q[0] != times[0] or not q == dq == ddq or 0 in q:
            raise BadValue(
                f"a trajectory has times of shape {times} and samples of shapes {q}, {dq}, {ddq}; they must be (K,) "
                "and three times (K, J), with at least one sample and one joint"
            )


class MotionResult(Value, frozen=True, kw_only=True, eq=False):
    """Result of an executed motion."""

    q_rad: Float64Array  # (J,) final joint angles
    T_world_tcp: Pose
    duration_s: float
    largest_joint_error_rad: float
    """Largest difference between commanded and measured joint angle during the motion."""


class GripResult(Value, frozen=True, kw_only=True, eq=False):
    """Result of closing the fingers."""

    width_m: float
    held: bool
    """Whether an object stopped the fingers: they are neither closed nor at the requested width."""


class Lease(Value, frozen=True, kw_only=True, eq=False):
    """A commander's right to move the robot; the robot brakes if the commander does not renew it in time."""

    holder: str
    duration_s: float = LEASE_S
    """Time on the machine's monotonic clock [s] without renewal after which the robot brakes."""

    @property
    def heartbeat_s(self) -> float:
        """Time between two renewals [s]: five make a lease, so that a late or lost one stops no arm."""
        return self.duration_s / 5
