"""Checks of an arm's postures: distances of its capsules to the table and to one another. Pure.

A failure is a `SkillFailure` with a `RobotReason`; its message states the violation, the limit and what to do.
"""

from dataclasses import dataclass

import numpy as np

from dlokit.description.arm.model import ArmModel
from dlokit.description.table import TABLE_TOP_M
from dlokit.errors import SkillFailure
from dlokit.motion.forward_kinematics import capsule_ends
from dlokit.types.arrays import Float64Array, Int64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotReason

TABLE_CLEARANCE_M = 0.001
"""Smallest distance of any part of the arm from the table [m]; fingertips grasp 2 mm above it."""
COLLISION_STEP_RAD = 0.03
"""Largest joint step between two configurations that are checked for collisions [rad]: the hand moves by less than
3 cm."""


def check_collisions(arm: ArmModel, q_rad: Float64Array, T_world_base: Pose | None = None) -> None:
    """Check that configurations (K, J) [rad] keep clear of the table and of the arm itself. Raises `SkillFailure`."""
    start, end = capsule_ends(arm, q_rad, T_world_base=T_world_base)
    _check_table(arm, start, end)
    if arm.gripper.tip_drop:  # the fingers may close at any time
        _check_table(arm, *capsule_ends(arm, q_rad, arm.gripper.lowest_width_m, T_world_base))
    firsts, seconds = arm.meeting_capsules
    first, second = (Capsules(start[:, parts], end[:, parts], arm.radii_m[list(parts)]) for parts in (firsts, seconds))
    gap = capsule_distances(first, second)  # the capsules already enclose the surface
    if np.any(gap < 0.0):
        _, pair = np.unravel_index(int(np.argmin(gap)), gap.shape)
        raise SkillFailure(
            RobotReason.SELF_COLLISION,
            f"{arm.capsules[firsts[pair]].link} and {arm.capsules[seconds[pair]].link} would come within "
            f"{-gap.min() * 1e3:.0f} mm of less than they may; go through another posture, e.g. home",
        )


def _check_table(arm: ArmModel, start: Float64Array, end: Float64Array) -> None:
    lowest = np.minimum(start[..., 2], end[..., 2]) - arm.radii_m - TABLE_TOP_M
    above = np.array([capsule.link in arm.above_table for capsule in arm.capsules])
    lowest = np.where(above, lowest, np.inf)
    if np.any(lowest < TABLE_CLEARANCE_M):
        _, part = np.unravel_index(int(np.argmin(lowest)), lowest.shape)
        raise SkillFailure(
            RobotReason.TABLE_COLLISION,
            f"{arm.capsules[part].link} would come to {lowest.min() * 1e3:.1f} mm above the table, at least "
            f"{TABLE_CLEARANCE_M * 1e3:.1f} mm are allowed; raise the path (a gripper pointing down may bring "
            f"its tool centre point to {arm.gripper.grasp_height_m() * 1e3:.0f} mm)",
        )


def thinned(q: Float64Array, step_rad: float) -> Float64Array:
    """Rows of `q` (K, 7) [rad], `step_rad` apart in the joint that moves most, including the first and the last."""
    return q[thinned_rows(q, step_rad)]


def thinned_rows(q: Float64Array, step_rad: float) -> Int64Array:
    """The numbers of these rows."""
    travelled = np.concatenate(([0.0], np.cumsum(np.max(np.abs(np.diff(q, axis=0)), axis=1))))
    marks = np.arange(0.0, travelled[-1], step_rad)
    return np.unique(np.concatenate((np.searchsorted(travelled, marks), [len(q) - 1])))


@dataclass(frozen=True)
class Capsules:
    """Capsules of any shape (…) in the world: both ends of each and its radius."""

    starts_world: Float64Array  # (…, 3) [m]
    ends_world: Float64Array  # (…, 3) [m]
    radii_m: Float64Array  # (…) [m], or what broadcasts to it


def capsule_distances(first: Capsules, second: Capsules) -> Float64Array:
    """Distances (…) [m] between the surfaces of capsules, pair by pair; negative if two overlap."""
    between = segment_distances(first.starts_world, first.ends_world, second.starts_world, second.ends_world)
    return between - first.radii_m - second.radii_m


def segment_distances(a0: Float64Array, a1: Float64Array, b0: Float64Array, b1: Float64Array) -> Float64Array:
    """Distances between segments a and b (…, 3) [m], pair by pair; Ericson, Real-Time Collision Detection, 5.1.9."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    pairs = ((u, u), (v, v), (u, v), (u, w), (v, w))
    uu, vv, uv, uw, vw = (np.einsum("...i,...i->...", first, second) for first, second in pairs)
    determinant = uu * vv - uv**2
    # Parallel segments: any point of the first is valid, the clamps below correct the other.
    s = np.where(determinant > 1e-12, (uv * vw - vv * uw) / np.maximum(determinant, 1e-12), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / vv).clip(0.0, 1.0)
    s = ((uv * t - uw) / uu).clip(0.0, 1.0)
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
