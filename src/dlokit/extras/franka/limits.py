"""The joints' limits: motions keep a margin to them, and they must agree with the arm's own limits. Pure."""

from xml.etree import ElementTree

import msgspec
import numpy as np

from dlokit.description.arm.model import ArmModel
from dlokit.motion.limits import scaled, speed_ratio
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, JointTrajectory, SlowNearLimits

MOST_SPEED = 0.9
"""Largest speed of a set-point, relative to the limit of its joint: the arm overshoots it by 2 to 4 %, and stops itself
above the limit."""
_ROUNDING_RAD = 1e-3
_ROUNDING_RAD_S = 0.02
"""Difference between published tables of the same arm near the ends of the joints."""
_ANGLES = 101
"""Angles of each joint at which speed limits are compared."""
_SLOW_NEAR = "position_based_velocity_limits"


def below_speed_limits(trajectory: JointTrajectory, arm: ArmModel) -> JointTrajectory:
    """The same path, slowed down if a joint would exceed the fraction `MOST_SPEED` of its speed limit."""
    ratio = speed_ratio(trajectory, arm.limits)
    return trajectory if ratio <= MOST_SPEED else scaled(trajectory, MOST_SPEED / ratio)


def beyond_limits(arm: ArmModel, urdf: str) -> str:
    """The limit of the model that exceeds the arm's own description; empty if the arm allows all of them.

    An arm without a description (`urdf` is empty), such as a Panda, allows all limits.
    """
    if not urdf:
        return ""
    mine = arm.limits
    allowed = _limits(urdf, mine)
    if allowed is None:
        return "the arm's own description has no limits for seven joints: is --arm the arm that answers?"
    lower, upper = mine.position_lower_rad, mine.position_upper_rad
    outside_rad = np.maximum(allowed.position_lower_rad - lower, upper - allowed.position_upper_rad)
    joint = int(np.argmax(outside_rad))
    if outside_rad[joint] > _ROUNDING_RAD:
        return (
            f"joint {joint + 1} turns from {lower[joint]:.4f} to {upper[joint]:.4f} rad by the model {arm.title}, and "
            f"the arm allows {allowed.position_lower_rad[joint]:.4f} to {allowed.position_upper_rad[joint]:.4f}: {_DO}"
        )
    q = np.linspace(lower, upper, _ANGLES)
    for direction in (np.ones(q.shape), -np.ones(q.shape)):
        planned = MOST_SPEED * np.broadcast_to(mine.velocity_at(q, direction), q.shape)
        faster = planned - allowed.velocity_at(q, direction)
        sample, joint = np.unravel_index(int(np.argmax(faster)), faster.shape)
        if faster[sample, joint] > _ROUNDING_RAD_S:
            return (
                f"joint {joint + 1} moves at up to {planned[sample, joint]:.3f} rad/s at {q[sample, joint]:.3f} rad by "
                f"the model {arm.title}, {faster[sample, joint]:.3f} rad/s more than the arm allows there: {_DO}"
            )
    return ""


_DO = "is --arm the arm that answers? Describe it in a file with its own limits, and name that with --arm"


def _limits(urdf: str, mine: JointLimits) -> JointLimits | None:
    """The limits of the seven revolute joints of a description; acceleration and jerk limits come from `mine`.

    None if it is not a description, or lacks a limit as a finite number.
    """
    try:
        joints = [joint for joint in ElementTree.fromstring(urdf).iter("joint") if joint.get("type") == "revolute"]
        lower, upper, velocity = (_numbers(joints, "limit", name) for name in ("lower", "upper", "velocity"))
        slow = None
        if any(joint.find(_SLOW_NEAR) is not None for joint in joints):
            slow = SlowNearLimits(
                lower_rad=lower,
                upper_rad=upper,
                deceleration_rad_s2=_numbers(joints, _SLOW_NEAR, "deceleration_limit"),
                offset_rad_s=_numbers(joints, _SLOW_NEAR, "velocity_offset"),
            )
    except (ElementTree.ParseError, ValueError):
        return None
    return msgspec.structs.replace(
        mine, position_lower_rad=lower, position_upper_rad=upper, velocity_rad_s=velocity, slow_near=slow
    )


def _numbers(joints: list[ElementTree.Element], tag: str, name: str) -> Float64Array:
    """An attribute of a tag of each joint (7,). Raises `ValueError` unless there are seven finite numbers."""
    found = [joint.find(tag) for joint in joints]
    numbers = np.array([float("nan") if one is None else float(one.get(name, "nan")) for one in found])
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        raise ValueError(f"{tag} {name} of seven joints")
    return numbers
