"""Robot state, limits, trajectories and what became of a motion."""

import enum

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value
from dlokit.types.pose import Pose

FIRST_ROBOT = "panda"
"""Name of the arm at the world's origin."""


class RobotMode(enum.Enum):
    """What the arm is doing."""

    IDLE = "idle"
    MOVING = "moving"
    BRAKING = "braking"
    FAULT = "fault"
    """Stopped itself (reflex, lost commander); needs ``recover``."""


class JointLimits(Value, frozen=True, kw_only=True, eq=False):
    """What the joints may do; a trajectory outside is refused before it runs."""

    position_lower_rad: Float64Array  # (J,) [rad]
    position_upper_rad: Float64Array  # (J,) [rad]
    velocity_rad_s: Float64Array  # (J,)
    acceleration_rad_s2: Float64Array  # (J,)
    jerk_rad_s3: Float64Array  # (J,)


class RobotState(Message, frozen=True, kw_only=True, eq=False):
    """One robot, at one moment."""

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
    """Where the arm stands; None: at the world's origin."""
    stop_latched: bool = False
    """Whether a person has stopped the arm: neither it nor its fingers move until a person enables it."""


class JointTrajectory(Value, frozen=True, kw_only=True, eq=False):
    """A joint-space path in time, sampled densely enough for linear interpolation of the velocity.

    Raises `BadValue` where the arrays do not have the same number of samples and joints; `dlokit.motion.limits` checks
    the values.
    """

    times_s: Float64Array  # (K,) [s], rising from 0
    q_rad: Float64Array  # (K, J)
    dq_rad_s: Float64Array  # (K, J)
    ddq_rad_s2: Float64Array  # (K, J)

    def __post_init__(self) -> None:
        times, q, dq, ddq = (array.shape for array in (self.times_s, self.q_rad, self.dq_rad_s, self.ddq_rad_s2))
        if len(times) != 1 or len(q) != 2 or q[0] != times[0] or not q == dq == ddq or 0 in q:
            raise BadValue(
                f"a trajectory has times of shape {times} and samples of shapes {q}, {dq}, {ddq}; allowed are (K,) "
                "and three times (K, J), with at least one sample and one joint"
            )


class MotionResult(Value, frozen=True, kw_only=True, eq=False):
    """What was really executed."""

    q_rad: Float64Array  # (J,) where the joints ended
    T_world_tcp: Pose
    duration_s: float
    largest_joint_error_rad: float
    """Largest distance between commanded and measured joint angle on the way."""


class GripResult(Value, frozen=True, kw_only=True, eq=False):
    """How a grip ended."""

    width_m: float
    held: bool
    """Whether the fingers stopped on something that is neither empty air nor the width asked for."""


class Lease(Value, frozen=True, kw_only=True, eq=False):
    """A commander's right to move the robot; the robot brakes when it is not renewed in time."""

    holder: str
    duration_s: float = 0.2
    """Time on the machine's monotonic clock [s] without renewal after which the robot brakes."""
