"""Forward kinematics in plain NumPy: the poses of an arm's links at given joint angles, many configurations at once.

Everything is in the order of the arm's `links`, and in the frame of the robot's base unless the base's pose is given.
K configurations, J joints, L links, C capsules.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlokit.description.arm.model import ArmModel
from dlokit.geometry import matrix, pose_from_matrix
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState


@dataclass(frozen=True)
class PosedArm:
    """An arm and its joint angles."""

    arm: ArmModel
    state: RobotState


def _carried(yaw_rad: float, y_m: ArrayLike = 0.0, z_m: ArrayLike = 0.0) -> Float64Array:
    """A turn about z, moved by single values (4, 4), or by values (K,) each (K, 4, 4)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    T = np.zeros((*np.shape(y_m), 4, 4))
    T[...] = np.array([[cosine, -sine, 0.0, 0.0], [sine, cosine, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    T[..., 1, 3], T[..., 2, 3] = y_m, z_m
    return T


def joint_link_transforms(arm: ArmModel, q_rad: ArrayLike) -> Float64Array:
    """Transforms from the base to the base and the link of each joint, (K, 1 + J, 4, 4), for angles (K, J) [rad]."""
    q = np.atleast_2d(np.asarray(q_rad, dtype=np.float64))
    chain = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for index, joint in enumerate(arm.joints):
        T_parent = joint.T_parent_link
        cosine, sine = np.cos(q[:, index, None]), np.sin(q[:, index, None])
        step = np.empty((len(q), 4, 4))
        step[:] = T_parent
        step[:, :3, 0] = cosine * T_parent[:3, 0] + sine * T_parent[:3, 1]
        step[:, :3, 1] = cosine * T_parent[:3, 1] - sine * T_parent[:3, 0]
        chain.append(chain[-1] @ step)
    return np.stack(chain, axis=1)


def link_transforms(
    arm: ArmModel,
    q_rad: ArrayLike,
    finger_width_m: float | Float64Array | None = None,
    T_world_base: Pose | None = None,
) -> Float64Array:
    """Transforms from base (or world) to every link, (K, L, 4, 4), for angles (K, J) [rad].

    The fingertips are `finger_width_m` apart [m], one value or (K,); None: wide open.
    """
    joints = joint_link_transforms(arm, q_rad)
    hand = joints[:, -1] @ arm.T_last_hand
    width_m = arm.gripper.open_width_m if finger_width_m is None else finger_width_m
    half = width_m / 2
    drop_m = arm.gripper.tip_drop_m
    drops_m = np.array([*map(drop_m, width_m)]) if isinstance(width_m, np.ndarray) else drop_m(width_m)
    z = arm.gripper.finger_m + drops_m
    left = hand @ _carried(0.0, y_m=half, z_m=z)
    right = hand @ _carried(np.pi, y_m=-half, z_m=z)
    links = np.concatenate([joints, hand[:, None], left[:, None], right[:, None]], axis=1)
    return links if T_world_base is None else matrix(T_world_base) @ links


def tcp_matrices(arm: ArmModel, q_rad: ArrayLike) -> Float64Array:
    """Transforms from the base to the tool centre point, (K, 4, 4), for angles (K, J) [rad]."""
    return joint_link_transforms(arm, q_rad)[:, -1] @ arm.T_last_tcp


def tcp_pose(arm: ArmModel, q_rad: ArrayLike) -> Pose:
    """Pose of the tool centre point in the base frame, for angles (J,) [rad]."""
    return pose_from_matrix(tcp_matrices(arm, q_rad)[0])


def capsule_ends(
    arm: ArmModel, q_rad: ArrayLike, finger_width_m: float | None = None, T_world_base: Pose | None = None
) -> tuple[Float64Array, Float64Array]:
    """Both ends of the arm's capsules in the base frame (or the world), (K, C, 3) [m], for angles (K, J) [rad]."""
    links = [arm.links.index(capsule.link) for capsule in arm.capsules]
    T = link_transforms(arm, q_rad, finger_width_m, T_world_base)[:, links]
    start = np.array([capsule.start_m for capsule in arm.capsules])
    end = np.array([capsule.end_m for capsule in arm.capsules])
    rotation, offset = T[..., :3, :3], T[..., :3, 3]
    return (
        np.einsum("kcij,cj->kci", rotation, start) + offset,
        np.einsum("kcij,cj->kci", rotation, end) + offset,
    )
