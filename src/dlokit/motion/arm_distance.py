"""Distance between two arms, measured between the capsules around their links. Pure."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist

from dlokit import geometry
from dlokit.description.arm.model import ArmModel
from dlokit.errors import SkillFailure
from dlokit.motion.collisions import Capsules, capsule_distances, thinned
from dlokit.motion.forward_kinematics import PosedArm, capsule_ends
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.types.action import APPROACH_HEIGHT_M
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory, RobotReason

_REACTION_S = 0.08  # two periods of the state, and the time of a message
_LINE_STEP_RAD = 0.06
AS_FAR_M = 0.002  # smaller decreases of the distance are ignored [m]: few motions start away from the other arm
_BRAKING = np.array([0.0, 0.5, 1.0])  # fractions of the braking path at which arms are compared


class Apart:
    """Distances between two arms."""

    def __init__(self, first: ArmKinematics, second: ArmKinematics) -> None:
        self._arms = first, second

    def of_pair_m(self, first: Sequence[Pose], second: Sequence[Pose]) -> float:
        """Least distance [m] while both arms carry a pair along these tool poses, including the moves from and to home.

        Every pose of one arm is compared with every pose of the other, because their timing is not known. The second
        arm leaves home when the first is in place, and they return home in the better order. Minus infinity if an arm
        does not reach a pose.
        """
        try:
            a, b = (self._joints(arm, poses) for arm, poses in zip(self._arms, (first, second), strict=True))
        except SkillFailure:
            return -math.inf
        carrying_m = self.at_joints_m(a, b)
        if carrying_m <= 0.0:
            return carrying_m
        coming_m = self.at_joints_m(a[:1], _line_home(self._arms[1].arm, b[0]))
        going_m = max(
            self.at_joints_m(_line_home(self._arms[0].arm, a[-1]), b[-1:]),
            self.at_joints_m(a[-1:], _line_home(self._arms[1].arm, b[-1])),
        )
        return min(carrying_m, coming_m, going_m)

    def at_joints_m(self, first_rad: Float64Array, second_rad: Float64Array) -> float:
        """Least distance [m] over all pairs of joint angles (K, J) and (L, J) [rad]; negative if the arms overlap."""
        (first, second) = self._arms
        return _least_gap_m(
            _capsules(first.arm, first_rad, first.T_world_base), _capsules(second.arm, second_rad, second.T_world_base)
        )

    def _joints(self, arm: ArmKinematics, poses: Sequence[Pose]) -> Float64Array:
        """Joint angles (K + 2, J) [rad] at the poses, with a lifted pose before the first and after the last."""
        ways = (geometry.lifted(poses[0], APPROACH_HEIGHT_M), *poses, geometry.lifted(poses[-1], APPROACH_HEIGHT_M))
        return np.array([arm.inverse(pose, yaw=Yaw.EITHER) for pose in ways])


def _line_home(arm: ArmModel, q_rad: Float64Array) -> Float64Array:
    """Joint angles (K, J) [rad] from `q_rad` (J,) to home."""
    change = arm.home_q_rad - q_rad
    steps = int(np.ceil(np.max(np.abs(change)) / _LINE_STEP_RAD))
    return q_rad + np.linspace(0.0, 1.0, steps + 1)[:, None] * change


def check_apart(
    kinematics: ArmKinematics,
    trajectory: JointTrajectory,
    others: Sequence[PosedArm],
    clearance_m: float,
    step_rad: float,
) -> None:
    """Check that a trajectory keeps clear of the other arms at their present positions.

    Configurations at most `step_rad` apart are compared. Arms that are already nearer than allowed may move apart, but
    not come nearer. Raises `SkillFailure` ``arms_too_near``.
    """
    arm, T_world_base = kinematics.arm, kinematics.T_world_base
    q_rad = thinned(trajectory.q_rad, step_rad)
    for other in others:
        theirs = _capsules(other.arm, other.state.q_rad[None, :], other.state.T_world_base)
        nearest_m = _least_gap_m(_capsules(arm, q_rad, T_world_base), theirs)
        if nearest_m >= clearance_m:
            continue
        if nearest_m < _least_gap_m(_capsules(arm, q_rad[:1], T_world_base), theirs) - AS_FAR_M:
            raise SkillFailure(
                RobotReason.ARMS_TOO_NEAR,
                f"the arm would come to {nearest_m * 1e3:.0f} mm from the {other.state.robot} arm, at least "
                f"{clearance_m * 1e3:.0f} mm are allowed; move that one out of the way first",
            )


def stopping_gap_m(mine: PosedArm, other: PosedArm) -> float:
    """Least distance [m] of two arms that both brake now, until they are at rest; negative if they overlap."""
    return min(
        _posed_gap_m(mine, own, other, its) for own, its in zip(_braking_rad(mine), _braking_rad(other), strict=True)
    )


def gap_m(mine: PosedArm, other: PosedArm) -> float:
    """Distance [m] of two arms at their present positions; negative if they overlap."""
    return _posed_gap_m(mine, mine.state.q_rad, other, other.state.q_rad)


def _posed_gap_m(mine: PosedArm, own_rad: Float64Array, other: PosedArm, its_rad: Float64Array) -> float:
    """Distance [m] of two arms at the given joint angles (J,) [rad] instead of their present ones."""
    return _least_gap_m(
        _capsules(mine.arm, own_rad[None, :], mine.state.T_world_base),
        _capsules(other.arm, its_rad[None, :], other.state.T_world_base),
    )


def _braking_rad(posed: PosedArm) -> Float64Array:
    """Joint angles (3, J) [rad] along the braking path: the arm moves on for the reaction time, then brakes fully."""
    speed = posed.state.dq_rad_s
    path = speed * (_REACTION_S + np.abs(speed) / (2.0 * posed.arm.limits.acceleration_rad_s2))
    return posed.state.q_rad + _BRAKING[:, None] * path


def _least_gap_m(a: Capsules, b: Capsules) -> float:
    """Least distance [m] between the surfaces of capsules (A,) and (B,), over all pairs.

    The spheres around the capsules exclude most pairs; only a few are measured exactly.
    """
    centers = [(each.starts_world + each.ends_world) / 2 for each in (a, b)]
    surfaces = cdist(centers[0], centers[1]) - a.radii_m[:, None] - b.radii_m[None, :]
    halves = [np.linalg.norm(each.ends_world - each.starts_world, axis=1) for each in (a, b)]
    reach = halves[0][:, None] / 2 + halves[1][None, :] / 2
    i, j = np.nonzero(surfaces - reach <= np.min(surfaces))
    return float(
        np.min(
            capsule_distances(
                Capsules(a.starts_world[i], a.ends_world[i], a.radii_m[i]),
                Capsules(b.starts_world[j], b.ends_world[j], b.radii_m[j]),
            )
        )
    )


def _capsules(arm: ArmModel, q_rad: Float64Array, T_world_base: Pose | None) -> Capsules:
    """The capsules (K C,) of an arm at joint angles (K, J) [rad], one after the other, the fingers wide open."""
    starts, ends = capsule_ends(arm, q_rad, T_world_base=T_world_base)
    return Capsules(starts.reshape(-1, 3), ends.reshape(-1, 3), np.tile(arm.radii_m, len(starts)))
