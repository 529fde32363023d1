"""Poses and rotations in space.

Poses follow ``p_world = T_world_tcp @ p_tcp``; quaternions are (w, x, y, z); lengths in metres.
SciPy's rotations are loaded on first use, because every process loads this module for its settings.
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dlokit.errors import BadValue
from dlokit.types.arrays import Float64Array, as_numbers
from dlokit.types.pose import Pose

_DIGITS = 12  # of a rotation from angles in degrees: half a turn is then the exact quaternion


def pose(position_m: ArrayLike, wxyz: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> Pose:
    """A pose from a position (3,) [m] and a quaternion (4,), which is normalised.

    Raises `BadValue` if one of them is not finite, or the quaternion is zero.
    """
    quaternion = np.asarray(wxyz, dtype=np.float64)
    norm = np.linalg.norm(quaternion)
    if not 0.0 < norm < np.inf:
        raise BadValue(f"the quaternion wxyz is {quaternion}; give four finite numbers that are not all 0")
    return Pose(position_m=np.array(position_m, dtype=np.float64), wxyz=quaternion / norm)


def pose_from_angles(position_m: ArrayLike, rpy_deg: ArrayLike) -> Pose:
    """A pose from a position (3,) [m] and roll, pitch, yaw (3,): turns about the fixed x, y, then z [°]."""
    turned = scipy.spatial.transform.Rotation.from_euler("xyz", rpy_deg, degrees=True)
    return pose(position_m, np.round(turned.as_quat(scalar_first=True, canonical=True), _DIGITS))


def pose_from_matrix(matrix: ArrayLike) -> Pose:
    """A pose from a homogeneous matrix (4, 4)."""
    T = np.asarray(matrix, dtype=np.float64)
    return Pose(
        position_m=T[:3, 3].copy(),
        wxyz=scipy.spatial.transform.Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True, canonical=True),
    )


_STRAIGHT = 1e-6  # sine of the angle to the vertical below which a view counts as straight up or down


def looking_along(forward: ArrayLike) -> Float64Array:
    """The rotation (3, 3) of an upright camera (x right, y down, z forward) that looks along a vector (3,), not zero.

    Its x axis is horizontal; of a camera that looks straight up or down it is the frame's x axis.
    """
    z = np.asarray(forward, dtype=np.float64)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(x)
    x = np.array([1.0, 0.0, 0.0]) if sine < _STRAIGHT else x / sine
    return np.column_stack((x, np.cross(z, x), z))


def rigid_pose(values: ArrayLike, name: str) -> Pose:
    """The pose of a caller's matrix (4, 4).

    Raises `BadValue`, which calls the matrix `name`, unless it is a rotation with a position.
    """
    T = as_numbers(values, name)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise BadValue(f"{name} has the shape {T.shape}; needed is (4, 4), finite numbers")
    R = T[:3, :3]
    if not np.allclose(T[3], [0.0, 0.0, 0.0, 1.0], atol=1e-9):
        wrong = f"its last row is {T[3]}, needed is 0 0 0 1: transpose it if that is the last column"
    elif not np.allclose(R @ R.T, np.eye(3), atol=1e-3):  # three decimals are enough
        wrong = f"it scales or shears: its axes have the lengths {np.linalg.norm(R, axis=0)}, needed is 1"
    elif np.linalg.det(R) < 0.0:
        wrong = "it mirrors, as from a left-handed frame; reverse one axis"
    else:
        return pose_from_matrix(T)
    raise BadValue(f"{name} is no rigid transform: {wrong}; p_a = T_a_b p_b, with the position in metres")


def homogeneous(R: ArrayLike, position_m: ArrayLike) -> Float64Array:
    """The homogeneous matrix (4, 4) of a rotation (3, 3) and a position (3,) [m]."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position_m
    return T


def matrix(T: Pose) -> Float64Array:
    """The homogeneous matrix (4, 4) of a pose."""
    return homogeneous(rotation(T), T.position_m)


def rotation(T: Pose) -> Float64Array:
    """The rotation matrix (3, 3) of a pose."""
    return scipy.spatial.transform.Rotation.from_quat(T.wxyz, scalar_first=True).as_matrix()


def compose(T_a_b: Pose, T_b_c: Pose) -> Pose:
    """Compose two poses: ``T_a_c``."""
    return pose_from_matrix(matrix(T_a_b) @ matrix(T_b_c))


def inverse(T_a_b: Pose) -> Pose:
    """Invert a pose: ``T_b_a``."""
    R = rotation(T_a_b)
    return pose_from_matrix(homogeneous(R.T, -R.T @ T_a_b.position_m))


def transform(T_a_b: Pose, points_b: ArrayLike) -> Float64Array:
    """Transform points (N, 3) [m] from frame b to frame a."""
    return np.asarray(points_b, dtype=np.float64) @ rotation(T_a_b).T + T_a_b.position_m


def downward(position_m: ArrayLike, yaw_rad: float) -> Pose:
    """A tool pose whose z axis points straight down and whose x axis is at `yaw_rad` in the table plane."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    R = [[cosine, sine, 0.0], [sine, -cosine, 0.0], [0.0, 0.0, -1.0]]
    return pose_from_matrix(homogeneous(R, position_m))


def lifted(T: Pose, height_m: float) -> Pose:
    """The pose translated by `height_m` along z of its reference frame."""
    return pose(T.position_m + np.array([0.0, 0.0, height_m]), T.wxyz)
