"""The robot's known shape in the world: capsules carried along by forward kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.description.panda_kinematics import capsule_ends
from dlokit.description.panda_shape import PANDA_COLLISION
from dlokit.types.robot import RobotState

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Capsules:
    """C capsules in the world frame: all points within a radius of a segment."""

    starts_world: Array  # (C, 3) [m]
    ends_world: Array  # (C, 3) [m]
    radii_m: Array  # (C,)


def panda_capsules(robots: Sequence[RobotState]) -> Capsules:
    """What is known of the robots' shape, from their joint angles and finger widths."""
    ends = [
        capsule_ends(state.q_rad, state.finger_width_m, T_world_base=state.T_world_base)  # of one configuration
        for state in robots
    ]
    nowhere = np.zeros((0, 3))
    return Capsules(
        starts_world=np.concatenate([nowhere, *(start[0] for start, _ in ends)]),
        ends_world=np.concatenate([nowhere, *(end[0] for _, end in ends)]),
        radii_m=np.array([capsule.radius_m for capsule in PANDA_COLLISION] * len(robots)),
    )
