"""How near two arms come to one another, by the capsules around their links. Pure."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.description.panda_kinematics import capsule_ends
from dlokit.description.panda_shape import PANDA_COLLISION
from dlokit.skills.robot.checks import segment_distances
from dlokit.skills.robot.kinematics import PandaKinematics
from dlokit.types.pose import Pose

Array = NDArray[np.float64]

_RADII = np.array([capsule.radius_m for capsule in PANDA_COLLISION])


class Apart:
    """The distance of two arms."""

    def __init__(self, first: PandaKinematics, second: PandaKinematics) -> None:
        self._arms = first, second

    def at_poses_m(self, first: Sequence[Pose], second: Sequence[Pose]) -> float:
        """Least distance [m] with the first arm's tool at any of its poses and the second's at any of its own.

        Every one against every other, so that neither has to be in time. Raises `SkillFailure` ``unreachable``.
        """
        return self.at_joints_m(
            np.array([self._arms[0].inverse(pose) for pose in first]),
            np.array([self._arms[1].inverse(pose) for pose in second]),
        )

    def at_joints_m(self, first_rad: Array, second_rad: Array) -> float:
        """The same for joint angles (K, 7) and (L, 7) [rad]; negative where they overlap."""
        (a0, a1), (b0, b1) = _capsules(first_rad, self._arms[0]), _capsules(second_rad, self._arms[1])
        gap = segment_distances(a0[:, None, :, None], a1[:, None, :, None], b0[None, :, None, :], b1[None, :, None, :])
        return float(np.min(gap - _RADII[:, None] - _RADII[None, :]))


def _capsules(q_rad: Array, arm: PandaKinematics) -> tuple[Array, Array]:
    """Ends of the capsules (K, C, 3) [m] in the world."""
    start, end = capsule_ends(q_rad)
    T = arm.T_world_base
    if T is None:
        return start, end
    R = geometry.rotation(T)
    return start @ R.T + T.position_m, end @ R.T + T.position_m
