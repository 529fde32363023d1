"""How near two arms come to one another, by the capsules around their links. Pure."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist

from dlokit import geometry
from dlokit.description.arm.panda import PANDA_HOME_Q_RAD, PANDA_LIMITS
from dlokit.errors import SkillFailure
from dlokit.motion.capsules import RADII_M, Capsules, capsule_distances
from dlokit.motion.collisions import thinned
from dlokit.motion.forward_kinematics import capsule_ends
from dlokit.motion.inverse_kinematics import PandaKinematics, Yaw
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory, RobotReason, RobotState

_REACTION_S = 0.08  # two periods of the state, and the way of a message
_LINE_STEP_RAD = 0.06
AS_FAR_M = 0.002  # arms may come nearer by so much and count as no nearer: a motion seldom starts away from the other
_BRAKING = np.array([0.0, 0.5, 1.0])  # fractions of the braking path at which arms are compared


class Apart:
    """The distance of two arms."""

    def __init__(self, first: PandaKinematics, second: PandaKinematics, *, lift_m: float = 0.06) -> None:
        """`lift_m` is the height above grasps and releases at which joint-space motions from and to home begin."""
        self._arms = first, second
        self._lift_m = lift_m

    def of_pair_m(self, first: Sequence[Pose], second: Sequence[Pose]) -> float:
        """Least distance [m] while both arms carry a pair along these tool poses, come from home and go back there.

        On the way every pose is held against every other, so that neither has to be in time. The second arm comes from
        home when the first stands ready, and they go home in the better order. Less than any distance where an arm does
        not reach a pose.
        """
        try:
            a, b = (self._joints(arm, poses) for arm, poses in zip(self._arms, (first, second), strict=True))
        except SkillFailure:
            return -math.inf
        carrying_m = self.at_joints_m(a, b)
        if carrying_m <= 0.0:
            return carrying_m
        coming_m = self.at_joints_m(a[:1], _line(b[0]))
        going_m = max(self.at_joints_m(_line(a[-1]), b[-1:]), self.at_joints_m(a[-1:], _line(b[-1])))
        return min(carrying_m, coming_m, going_m)

    def at_joints_m(self, first_rad: Float64Array, second_rad: Float64Array) -> float:
        """The same for joint angles (K, 7) and (L, 7) [rad], all against all; negative where they overlap."""
        first = _capsules(first_rad, self._arms[0].T_world_base)
        second = _capsules(second_rad, self._arms[1].T_world_base)
        return _least_gap_m(first, second)

    def _joints(self, arm: PandaKinematics, poses: Sequence[Pose]) -> Float64Array:
        """Joint angles (K + 2, 7) [rad] at the poses, and lifted before the first and after the last of them."""
        ways = (geometry.lifted(poses[0], self._lift_m), *poses, geometry.lifted(poses[-1], self._lift_m))
        return np.array([arm.inverse(pose, yaw=Yaw.EITHER) for pose in ways])


def _line(q_rad: Float64Array) -> Float64Array:
    """Joint angles (K, 7) [rad] from some to home."""
    way = PANDA_HOME_Q_RAD - q_rad
    steps = int(np.ceil(np.max(np.abs(way)) / _LINE_STEP_RAD))
    return q_rad + np.linspace(0.0, 1.0, steps + 1)[:, None] * way


def check_apart(
    trajectory: JointTrajectory,
    T_world_base: Pose | None,
    others: Sequence[RobotState],
    clearance_m: float,
    step_rad: float,
) -> None:
    """Hold a trajectory of an arm at `T_world_base` clear of the other arms where they are.

    Configurations at most `step_rad` apart are compared. Arms that are nearer than they may already may part, but not
    come nearer. Raises `SkillFailure` ``arms_too_near``.
    """
    q_rad = thinned(trajectory.q_rad, step_rad)
    for other in others:
        theirs = _capsules(other.q_rad[None, :], other.T_world_base)
        nearest_m = _least_gap_m(_capsules(q_rad, T_world_base), theirs)
        if nearest_m >= clearance_m:
            continue
        if nearest_m < _least_gap_m(_capsules(q_rad[:1], T_world_base), theirs) - AS_FAR_M:
            raise SkillFailure(
                RobotReason.ARMS_TOO_NEAR,
                f"the arm would come to {nearest_m * 1e3:.0f} mm from {other.robot}, at least "
                f"{clearance_m * 1e3:.0f} mm are allowed; move {other.robot} out of the way first",
            )


def stopping_gap_m(mine: RobotState, other: RobotState) -> float:
    """Least distance [m] of two arms that both brake now, until they stand; negative where they overlap."""
    return min(
        _least_gap_m(_capsules(own[None, :], mine.T_world_base), _capsules(its[None, :], other.T_world_base))
        for own, its in zip(_braking_rad(mine), _braking_rad(other), strict=True)
    )


def gap_m(mine: RobotState, other: RobotState) -> float:
    """Distance [m] of two arms as they are; negative where they overlap."""
    return _least_gap_m(
        _capsules(mine.q_rad[None, :], mine.T_world_base), _capsules(other.q_rad[None, :], other.T_world_base)
    )


def _braking_rad(state: RobotState) -> Float64Array:
    """Joint angles (3, 7) [rad] on the way to a stand: on for the reaction, then braked as hard as allowed."""
    speed = state.dq_rad_s
    way = speed * (_REACTION_S + np.abs(speed) / (2.0 * PANDA_LIMITS.acceleration_rad_s2))
    return state.q_rad + _BRAKING[:, None] * way


def _least_gap_m(first: tuple[Float64Array, Float64Array], second: tuple[Float64Array, Float64Array]) -> float:
    """Least distance [m] of the surfaces of capsules (K, C, 3) and (L, C, 3), each configuration against each.

    The spheres around the capsules exclude most pairs; only a few are measured exactly.
    """
    (a0, a1), (b0, b1) = ((start.reshape(-1, 3), end.reshape(-1, 3)) for start, end in (first, second))
    ra, rb = (np.tile(RADII_M, len(start) // len(RADII_M)) for start in (a0, b0))
    surfaces = cdist((a0 + a1) / 2, (b0 + b1) / 2) - ra[:, None] - rb[None, :]
    reach = np.linalg.norm(a1 - a0, axis=1)[:, None] / 2 + np.linalg.norm(b1 - b0, axis=1)[None, :] / 2
    i, j = np.nonzero(surfaces - reach <= np.min(surfaces))
    return float(np.min(capsule_distances(Capsules(a0[i], a1[i], ra[i]), Capsules(b0[j], b1[j], rb[j]))))


def _capsules(q_rad: Float64Array, T_world_base: Pose | None) -> tuple[Float64Array, Float64Array]:
    """Ends of the capsules (K, C, 3) [m] in the world; the fingers wide open."""
    return capsule_ends(q_rad, T_world_base=T_world_base)
