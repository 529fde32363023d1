"""Where the Panda's links are at given joint angles: forward kinematics in plain NumPy, many configurations at once.

Everything is in the order of `PANDA_LINKS`, and in the frame of the robot's base unless it is said where that stands.
"""

import numpy as np
from numpy.typing import ArrayLike

from dlokit.description.arm.panda import (
    PANDA_COLLISION,
    PANDA_DH,
    PANDA_FINGER_M,
    PANDA_FLANGE_M,
    PANDA_HAND_YAW_RAD,
    PANDA_LINKS,
    PANDA_OPEN_WIDTH_M,
    PANDA_TCP_M,
)
from dlokit.geometry import matrix, pose_from_matrix
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose


def _fixed(yaw_rad: float, y_m: float = 0.0, z_m: float = 0.0) -> Float64Array:
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine, 0.0, 0.0], [sine, cosine, 0.0, y_m], [0.0, 0.0, 1.0, z_m], [0.0, 0.0, 0.0, 1.0]])


_T_LINK7_HAND = _fixed(PANDA_HAND_YAW_RAD, z_m=PANDA_FLANGE_M)
_T_LINK7_TCP = _T_LINK7_HAND @ _fixed(0.0, z_m=PANDA_TCP_M)


def _joint_transforms(q_rad: Float64Array) -> list[Float64Array]:
    """Transforms from each link to the next, seven arrays (K, 4, 4), for angles (K, 7) [rad]."""
    steps: list[Float64Array] = []
    for index, joint in enumerate(PANDA_DH):
        turn_cos, turn_sin = np.cos(joint.alpha_rad), np.sin(joint.alpha_rad)
        cosine, sine = np.cos(q_rad[:, index]), np.sin(q_rad[:, index])
        T = np.zeros((len(q_rad), 4, 4))
        T[:, 0, 0], T[:, 0, 1], T[:, 0, 3] = cosine, -sine, joint.a_m
        T[:, 1, 0], T[:, 1, 1] = sine * turn_cos, cosine * turn_cos
        T[:, 1, 2], T[:, 1, 3] = -turn_sin, -turn_sin * joint.d_m
        T[:, 2, 0], T[:, 2, 1] = sine * turn_sin, cosine * turn_sin
        T[:, 2, 2], T[:, 2, 3] = turn_cos, turn_cos * joint.d_m
        T[:, 3, 3] = 1.0
        steps.append(T)
    return steps


def arm_transforms(q_rad: ArrayLike) -> Float64Array:
    """Transforms from ``link0`` to each of ``link0`` … ``link7``, (K, 8, 4, 4), for angles (K, 7) [rad]."""
    q = np.atleast_2d(np.asarray(q_rad, dtype=np.float64))
    chain = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for step in _joint_transforms(q):
        chain.append(chain[-1] @ step)
    return np.stack(chain, axis=1)


def link_transforms(
    q_rad: ArrayLike, finger_width_m: float = PANDA_OPEN_WIDTH_M, T_world_base: Pose | None = None
) -> Float64Array:
    """Transforms from base (or world) to every link of `PANDA_LINKS`, (K, 11, 4, 4), for angles (K, 7) [rad]."""
    arm = arm_transforms(q_rad)
    hand = arm[:, 7] @ _T_LINK7_HAND
    half = finger_width_m / 2
    left = hand @ _fixed(0.0, y_m=half, z_m=PANDA_FINGER_M)
    right = hand @ _fixed(np.pi, y_m=-half, z_m=PANDA_FINGER_M)
    links = np.concatenate([arm, hand[:, None], left[:, None], right[:, None]], axis=1)
    return links if T_world_base is None else matrix(T_world_base) @ links


def tcp_matrices(q_rad: ArrayLike) -> Float64Array:
    """Transforms from the base to the tool centre point, (K, 4, 4), for angles (K, 7) [rad]."""
    return arm_transforms(q_rad)[:, 7] @ _T_LINK7_TCP


def tcp_pose(q_rad: ArrayLike) -> Pose:
    """Pose of the tool centre point in the base frame, for angles (7,) [rad]."""
    return pose_from_matrix(tcp_matrices(q_rad)[0])


def capsule_ends(
    q_rad: ArrayLike, finger_width_m: float = PANDA_OPEN_WIDTH_M, T_world_base: Pose | None = None
) -> tuple[Float64Array, Float64Array]:
    """Both ends of `PANDA_COLLISION` in the base frame (or the world), (K, C, 3) [m], for angles (K, 7) [rad]."""
    links = [PANDA_LINKS.index(capsule.link) for capsule in PANDA_COLLISION]
    T = link_transforms(q_rad, finger_width_m, T_world_base)[:, links]
    start = np.array([capsule.start_m for capsule in PANDA_COLLISION])
    end = np.array([capsule.end_m for capsule in PANDA_COLLISION])
    rotation, offset = T[..., :3, :3], T[..., :3, 3]
    return (
        np.einsum("kcij,cj->kci", rotation, start) + offset,
        np.einsum("kcij,cj->kci", rotation, end) + offset,
    )
