"""Errors by which the arm itself ends a motion: libfranka's names, and dlokit's reactions. Standard library only."""

import enum

from dlokit.extras.franka.channel import Latch


class Reaction(enum.Enum):
    """The reaction to an error of the arm."""

    PERSON = enum.auto()
    """The stop latches: a person looks at the arm, and enables it."""
    RECOVER = enum.auto()
    """A set-point was late, or jumped because an earlier one was late; nothing is damaged. The task may recover, a
    bounded number of times."""
    FAULT = enum.auto()
    """The motion exceeded the arm's limits. The task ends; `recover` clears the error."""


_P, _R, _F = Reaction.PERSON, Reaction.RECOVER, Reaction.FAULT

REFLEXES: dict[str, Reaction] = {
    "joint_reflex": _P,
    "cartesian_reflex": _P,
    "self_collision_avoidance_violation": _P,
    "joint_position_limits_violation": _P,
    "cartesian_position_limits_violation": _P,
    "force_control_safety_violation": _P,
    "power_limit_violation": _P,
    "instability_detected": _P,
    "base_acceleration_initialization_timeout": _P,
    "base_acceleration_invalid_reading": _P,
    "communication_constraints_violation": _R,
    "controller_torque_discontinuity": _R,
    "joint_motion_generator_velocity_discontinuity": _R,
    "joint_motion_generator_acceleration_discontinuity": _R,
    "cartesian_motion_generator_velocity_discontinuity": _R,
    "cartesian_motion_generator_acceleration_discontinuity": _R,
    "cartesian_motion_generator_joint_velocity_discontinuity": _R,
    "cartesian_motion_generator_joint_acceleration_discontinuity": _R,
    "joint_velocity_violation": _F,
    "cartesian_velocity_violation": _F,
    "cartesian_velocity_profile_safety_violation": _F,
    "tau_j_range_violation": _F,
    "joint_motion_generator_position_limits_violation": _F,
    "joint_motion_generator_velocity_limits_violation": _F,
    "joint_position_motion_generator_start_pose_invalid": _F,
    "joint_move_in_wrong_direction": _F,
    "joint_p2p_insufficient_torque_for_planning": _F,
    "joint_via_motion_generator_planning_joint_limit_violation": _F,
    "max_goal_pose_deviation_violation": _F,
    "max_path_pose_deviation_violation": _F,
    "cartesian_motion_generator_elbow_limit_violation": _F,
    "cartesian_motion_generator_elbow_sign_inconsistent": _F,
    "cartesian_motion_generator_joint_position_limits_violation": _F,
    "cartesian_motion_generator_joint_velocity_limits_violation": _F,
    "cartesian_motion_generator_start_elbow_invalid": _F,
    "cartesian_motion_generator_velocity_limits_violation": _F,
    "cartesian_position_motion_generator_invalid_frame": _F,
    "cartesian_position_motion_generator_start_pose_invalid": _F,
    "cartesian_spline_motion_generator_violation": _F,
    "force_controller_desired_force_tolerance_violation": _F,
    "start_elbow_sign_inconsistent": _F,
}
"""Every error of libfranka 0.21, by the name of its flag."""

NAMES = tuple(REFLEXES)
"""Their order: bit i of an error word is `NAMES[i]`."""
COLLISIONS = frozenset(("joint_reflex", "cartesian_reflex"))


class ArmMode(enum.IntEnum):
    """ArmMode of the arm, by libfranka's number."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


def named(errors: int) -> tuple[str, ...]:
    """The names of an error word's bits."""
    return tuple(name for bit, name in enumerate(NAMES) if errors >> bit & 1)


def reaction(errors: int) -> Reaction:
    """The reaction to several errors at once: the most careful reaction; without errors, `Reaction.FAULT`."""
    found = {REFLEXES[name] for name in named(errors)}
    if Reaction.PERSON in found:
        return Reaction.PERSON
    return Reaction.RECOVER if found == {Reaction.RECOVER} else Reaction.FAULT


def latch_of(mode: int, errors: int) -> Latch:
    """Why the arm must wait for a person, by its mode and its errors."""
    if mode == ArmMode.USER_STOPPED:
        return Latch.USER_STOP
    if mode == ArmMode.GUIDING:
        return Latch.GUIDING
    if COLLISIONS.intersection(named(errors)):
        return Latch.COLLISION
    return Latch.ARM_ERROR if reaction(errors) is Reaction.PERSON else Latch.NONE
