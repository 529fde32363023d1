"""The robot's known shape in the world: capsules carried along by forward kinematics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.description.panda_data import PANDA_DH, PANDA_FINGER_M, PANDA_FLANGE_M, PANDA_HAND_YAW_RAD
from dlokit.description.panda_shape import PANDA_COLLISION
from dlokit.geometry import matrix
from dlokit.types.robot import RobotState

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Capsules:
    """C capsules in the world frame: all points within a radius of a segment."""

    starts_world: Array  # (C, 3) [m]
    ends_world: Array  # (C, 3) [m]
    radii_m: Array  # (C,)


NO_CAPSULES = Capsules(starts_world=np.zeros((0, 3)), ends_world=np.zeros((0, 3)), radii_m=np.zeros(0))


def panda_capsules(robots: Sequence[RobotState]) -> Capsules:
    """What is known of the robots' shape, from their joint angles and finger widths."""
    if not robots:
        return NO_CAPSULES
    starts: list[Array] = []
    ends: list[Array] = []
    for state in robots:
        frames = panda_link_frames(state.q_rad, state.finger_width_m)
        if state.T_world_base is not None:
            T_world_base = matrix(state.T_world_base)
            frames = {link: T_world_base @ T for link, T in frames.items()}
        for capsule in PANDA_COLLISION:
            T = frames[capsule.link]
            starts.append(T[:3, :3] @ np.array(capsule.start_m) + T[:3, 3])
            ends.append(T[:3, :3] @ np.array(capsule.end_m) + T[:3, 3])
    radii = np.array([capsule.radius_m for capsule in PANDA_COLLISION] * len(robots))
    return Capsules(starts_world=np.array(starts), ends_world=np.array(ends), radii_m=radii)


def panda_link_frames(q_rad: Array, finger_width_m: float) -> dict[str, Array]:
    """Homogeneous matrices (4, 4) of every link of a Panda whose base is the world frame."""
    frame = np.eye(4)
    frames = {"link0": frame}
    for index, (joint, q) in enumerate(zip(PANDA_DH, q_rad, strict=True)):
        frame = (
            frame
            @ _turned_x(joint.alpha_rad)
            @ _moved(joint.a_m, 0.0, 0.0)
            @ _turned_z(float(q))
            @ _moved(0, 0, joint.d_m)
        )
        frames[f"link{index + 1}"] = frame
    hand = frame @ _moved(0.0, 0.0, PANDA_FLANGE_M) @ _turned_z(PANDA_HAND_YAW_RAD)
    frames["hand"] = hand
    # Both fingers are alike: each slides along its own y by half of the width.
    slide = _moved(0.0, finger_width_m / 2, 0.0)
    frames["left_finger"] = hand @ _moved(0.0, 0.0, PANDA_FINGER_M) @ slide
    frames["right_finger"] = hand @ _moved(0.0, 0.0, PANDA_FINGER_M) @ _turned_z(np.pi) @ slide
    return frames


def _moved(x_m: float, y_m: float, z_m: float) -> Array:
    T = np.eye(4)
    T[:3, 3] = (x_m, y_m, z_m)
    return T


def _turned_x(angle_rad: float) -> Array:
    T = np.eye(4)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    T[1:3, 1:3] = [[c, -s], [s, c]]
    return T


def _turned_z(angle_rad: float) -> Array:
    T = np.eye(4)
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    T[:2, :2] = [[c, -s], [s, c]]
    return T
