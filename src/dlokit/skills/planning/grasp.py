"""Grasps: vertical, perpendicular to the rod's tangent, with free space for both fingers."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.arm.model import ArmModel, Gripper
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

SAMPLE_M = 0.002
"""Distance of the points at which the rod is checked against the fingers [m]."""
END_INSET_M = 0.012
"""Distance of a grasp from the rod's ends [m], so that the pads are filled."""
OPENINGS_M = (0.05, 0.04, 0.03, 0.02)
"""Openings of the fingers [m] in this order, as far as the gripper opens: wide ones tolerate errors, narrow ones fit
between strands."""
FINGER_THICKNESS_M = 0.012
"""Extent of a finger across the rod, outwards from its pad [m]."""
CLEARANCE_M = 0.002
"""Free space between a finger and the rod's surface [m]."""
_FINGER_WIDTH_M = 0.02  # extent of a finger along the rod
_ADJACENT = np.pi / 2.0  # the grasped strand is as much longer between the fingers than they are wide, where it bends


@dataclass(frozen=True)
class RodPoint:
    """A point of a rod."""

    s_m: float
    """Length along the rod [m]."""
    position_world: Float64Array  # (3,) [m]
    yaw_rad: float
    """Direction of the rod in the table plane, from the first node to the last [rad]."""


def rod_point(nodes_world: Float64Array, fraction: float) -> RodPoint:
    """The point of a rod (M, 3) [m] at the fraction `fraction` of its length, 0 to 1."""
    s = geometry.arc_lengths(nodes_world)
    at = fraction * s[-1]
    tangents = geometry.tangents(nodes_world)
    position = np.array([np.interp(at, s, nodes_world[:, axis]) for axis in range(3)])
    tangent = [np.interp(at, s, tangents[:, axis]) for axis in range(2)]
    return RodPoint(s_m=float(at), position_world=position, yaw_rad=float(np.arctan2(tangent[1], tangent[0])))


def grasp_fraction(nodes_world: Float64Array, node: int) -> float:
    """Grasp position for `node` of (M, 3) [m], as a fraction of the rod's length, not too near an end."""
    s = geometry.arc_lengths(nodes_world)
    inset = min(END_INSET_M / s[-1], 0.5)
    return float(np.clip(s[node] / s[-1], inset, 1.0 - inset))


def wrapped(angle_rad: float) -> float:
    """The same angle between -pi and pi [rad]."""
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def grasp_yaw(arm: ArmModel, point: RodPoint, turn_rad: float, place_m: tuple[float, float]) -> float:
    """Yaw of the tool at `point`: of the two perpendicular to the rod, the one with more room for the wrist [rad].

    `turn_rad` is the tool's later turn; the worse of both ends counts. The arm's base is at `place_m`.
    """
    x, y = point.position_world[:2] - np.array(place_m)
    middle = float(np.arctan2(y, x)) + arm.roomiest_yaw_rad
    first = wrapped(point.yaw_rad - middle)
    choices = (first, first - np.pi if first > 0.0 else first + np.pi)
    return min(choices, key=lambda yaw: max(abs(yaw), abs(yaw + turn_rad))) + middle


def grasp_pose(point: RodPoint, yaw_rad: float, height_m: float) -> Pose:
    """Tool pose for a grasp at `point`, `height_m` over the table [m]."""
    return geometry.downward((*point.position_world[:2], height_m), yaw_rad)


def fitting_opening_m(gripper: Gripper, nodes_world: Float64Array, point: RodPoint, radius_m: float) -> float | None:
    """The first finger opening at which the gripper fits around the rod (M, 3) [m] at `point`, or None.

    `radius_m` is the rod's [m].
    """
    return next(fitting_openings_m(gripper, nodes_world, point, radius_m), None)


def fitting_openings_m(
    gripper: Gripper, nodes_world: Float64Array, point: RodPoint, radius_m: float
) -> Iterator[float]:
    """All finger openings [m] at which it fits, the widest first."""
    for opening_m in (each for each in OPENINGS_M if each <= gripper.open_width_m):
        if gripper_fits(nodes_world, point, opening_m, radius_m):
            yield opening_m


def gripper_fits(nodes_world: Float64Array, point: RodPoint, opening_m: float, radius_m: float) -> bool:
    """Whether both fingers descend beside the rod (M, 3) [m], touch no other part, and enclose one strand only."""
    length = geometry.arc_lengths(nodes_world)[-1]
    count = int(length / SAMPLE_M) + 2
    points = geometry.resample(nodes_world, count)
    cosine, sine = np.cos(point.yaw_rad), np.sin(point.yaw_rad)
    offsets = points[:, :2] - point.position_world[:2]
    along = np.abs(offsets @ np.array([cosine, sine]))
    across = np.abs(offsets @ np.array([-sine, cosine]))
    reach = radius_m + CLEARANCE_M
    beside = along < _FINGER_WIDTH_M / 2.0 + reach
    strand = np.abs(np.linspace(0.0, length, count) - point.s_m) < _ADJACENT * (_FINGER_WIDTH_M / 2.0 + reach)
    within_fingers = across < opening_m / 2.0 + FINGER_THICKNESS_M + reach
    free_between = across < opening_m / 2.0 - reach
    return not np.any(beside & within_fingers & ~(strand & free_between))
