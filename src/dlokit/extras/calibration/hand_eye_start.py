"""Published closed solutions of the hand-eye problem, for a fixed camera and a board in the hand.

Each picture gives ``A = T_world_tcp`` and ``B = T_camera_board``; the unknowns are ``X = T_world_camera`` and ``Y =
T_tcp_board`` in ``A Y = X B``. The first four eliminate X between all pairs of pictures and solve ``A' Y = Y B'``, the
last two solve for both. The Python package of OpenCV 5 has the names of these methods, but not their functions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dlokit.geometry import homogeneous
from dlokit.types.arrays import Float64Array

_LEAST_TURN_RAD = 0.05
"""Least turn between the pictures of a pair [rad]: the axis of smaller turns is uncertain."""


@dataclass(frozen=True, kw_only=True)
class HandEyePoses:
    """A solution as matrices (4, 4)."""

    T_world_camera: Float64Array
    T_tcp_board: Float64Array


@dataclass(frozen=True, kw_only=True)
class _Pairs:
    """Relative motions between pairs of pictures, (P, 3, 3) and (P, 3), of the tool (a) and of the board (b)."""

    R_a: Float64Array
    t_a: Float64Array
    R_b: Float64Array
    t_b: Float64Array


def tsai(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Tsai and Lenz 1989: the rotation first, by modified Rodrigues vectors; then the translation."""
    pairs = _pairs(A, B)
    p_a, p_b = (2.0 * _quaternions(R)[:, 1:] for R in (pairs.R_a, pairs.R_b))
    rotation = _solved(skew(p_a + p_b).reshape(-1, 3), (p_b - p_a).ravel())
    # p' is the tangent of half the angle along the axis.
    quaternion = np.concatenate([[1.0], rotation])
    R = Rotation.from_quat(quaternion / np.linalg.norm(quaternion), scalar_first=True).as_matrix()
    return _with_camera(A, B, R, _translation(pairs, R))


def park(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Park and Martin 1994: the rotation that brings the logarithms of the motions together."""
    pairs = _pairs(A, B)
    a, b = (Rotation.from_matrix(R).as_rotvec() for R in (pairs.R_a, pairs.R_b))
    R = _nearest_rotation(a.T @ b)
    return _with_camera(A, B, R, _translation(pairs, R))


def horaud(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Horaud and Dornaika 1995: the unit quaternion that brings the axes of the motions together."""
    pairs = _pairs(A, B)
    a, b = (Rotation.from_matrix(R).as_rotvec() for R in (pairs.R_a, pairs.R_b))
    a, b = (axes / np.linalg.norm(axes, axis=1, keepdims=True) for axes in (a, b))
    R = Rotation.align_vectors(a, b)[0].as_matrix()
    return _with_camera(A, B, R, _translation(pairs, R))


def daniilidis(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Daniilidis 1999: rotation and translation at once, by dual quaternions."""
    pairs = _pairs(A, B)
    (q_a, d_a), (q_b, d_b) = _dual(pairs.R_a, pairs.t_a), _dual(pairs.R_b, pairs.t_b)
    rows = np.zeros((len(q_a), 6, 8))
    rows[:, :3, 0], rows[:, :3, 1:4] = (q_a - q_b)[:, 1:], skew((q_a + q_b)[:, 1:])
    rows[:, 3:, 0], rows[:, 3:, 1:4] = (d_a - d_b)[:, 1:], skew((d_a + d_b)[:, 1:])
    rows[:, 3:, 4:] = rows[:, :3, :4]
    u, v = np.linalg.svd(rows.reshape(-1, 8))[2][-2:]
    # The combination of the two null vectors that is a unit dual quaternion: q · q' = 0, |q| = 1.
    a, b, c = u[:4] @ u[4:], u[:4] @ v[4:] + u[4:] @ v[:4], v[:4] @ v[4:]
    ratios = np.roots([a, b, c]).real
    norms = [s**2 * u[:4] @ u[:4] + 2 * s * u[:4] @ v[:4] + v[:4] @ v[:4] for s in ratios]
    s, norm = ratios[int(np.argmax(norms))], max(norms)
    both = (s * u + v) / np.sqrt(norm)
    q, d = both[:4], both[4:]
    t = 2.0 * (q[0] * d[1:] - d[0] * q[1:] + np.cross(q[1:], d[1:]))
    return _with_camera(A, B, Rotation.from_quat(q, scalar_first=True).as_matrix(), t)


def shah(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Shah 2013: both rotations by the singular vectors of a sum of Kronecker products, then both translations."""
    K = sum(np.kron(b[:3, :3], a[:3, :3]) for a, b in zip(A, B, strict=True))
    u, _, vt = np.linalg.svd(np.asarray(K))
    R_x, R_y = u[:, 0].reshape(3, 3).T, vt[0].reshape(3, 3).T
    R_x, R_y = (_nearest_rotation(R * np.sign(np.linalg.det(R))) for R in (R_x, R_y))
    # A Y = X B in the translations: R_a t_y - t_x = R_x t_b - t_a.
    left = np.concatenate([A[:, :3, :3], np.broadcast_to(-np.eye(3), (len(A), 3, 3))], axis=2).reshape(-1, 6)
    t = _solved(left, (B[:, :3, 3] @ R_x.T - A[:, :3, 3]).ravel())
    return HandEyePoses(T_world_camera=homogeneous(R_x, t[3:]), T_tcp_board=homogeneous(R_y, t[:3]))


def li(A: Float64Array, B: Float64Array) -> HandEyePoses:
    """Li, Wang and Wu 2010: all entries of both transforms in one linear system, the rotations then made orthogonal."""
    rows: list[Float64Array] = []
    values: list[Float64Array] = []
    for a, b in zip(A, B, strict=True):
        # vec(R_a R_y) = vec(R_x R_b), and R_a t_y + t_a = R_x t_b + t_x; vec stacks rows.
        row = np.zeros((12, 24))
        row[:9, :9] = np.kron(a[:3, :3], np.eye(3))
        row[:9, 9:18] = -np.kron(np.eye(3), b[:3, :3].T)
        row[9:, 9:18] = -np.kron(np.eye(3), b[:3, 3])
        row[9:, 18:21], row[9:, 21:] = a[:3, :3], -np.eye(3)
        rows.append(row)
        values.append(np.concatenate([np.zeros(9), -a[:3, 3]]))
    z = _solved(np.concatenate(rows), np.concatenate(values))
    R_y, R_x = (_nearest_rotation(part.reshape(3, 3)) for part in (z[:9], z[9:18]))
    return HandEyePoses(T_world_camera=homogeneous(R_x, z[21:]), T_tcp_board=homogeneous(R_y, z[18:21]))


METHODS: Mapping[str, Callable[[Float64Array, Float64Array], HandEyePoses]] = {
    "tsai": tsai,
    "park": park,
    "horaud": horaud,
    "daniilidis": daniilidis,
    "shah": shah,
    "li": li,
}
"""Each method takes ``T_world_tcp`` and ``T_camera_board`` (N, 4, 4), N >= 3, with turns about two or more axes."""


def _pairs(A: Float64Array, B: Float64Array) -> _Pairs:
    first, second = np.triu_indices(len(A), 1)
    a, b = np.linalg.inv(A[second]) @ A[first], np.linalg.inv(B[second]) @ B[first]
    turn = Rotation.from_matrix(a[:, :3, :3]).magnitude()
    keep = turn > _LEAST_TURN_RAD
    return _Pairs(R_a=a[keep, :3, :3], t_a=a[keep, :3, 3], R_b=b[keep, :3, :3], t_b=b[keep, :3, 3])


def _translation(pairs: _Pairs, R: Float64Array) -> Float64Array:
    """The translation of Y from ``(R_a - I) t_y = R_y t_b - t_a``."""
    return _solved((pairs.R_a - np.eye(3)).reshape(-1, 3), (pairs.t_b @ R.T - pairs.t_a).ravel())


def _with_camera(A: Float64Array, B: Float64Array, R: Float64Array, t: Float64Array) -> HandEyePoses:
    """The solution with X, the mean of ``A Y B⁻¹`` over all pictures."""
    Y = homogeneous(R, t)
    X = A @ Y @ np.linalg.inv(B)
    R_x = Rotation.from_matrix(X[:, :3, :3]).mean().as_matrix()
    return HandEyePoses(T_world_camera=homogeneous(R_x, X[:, :3, 3].mean(axis=0)), T_tcp_board=Y)


def _solved(left: Float64Array, right: Float64Array) -> Float64Array:
    return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)


def _nearest_rotation(M: Float64Array) -> Float64Array:
    u, _, vt = np.linalg.svd(M)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def _quaternions(R: Float64Array) -> Float64Array:
    return Rotation.from_matrix(R).as_quat(scalar_first=True, canonical=True)


def _dual(R: Float64Array, t: Float64Array) -> tuple[Float64Array, Float64Array]:
    """The real and the dual part (P, 4) of motions as dual quaternions."""
    q = _quaternions(R)
    scalar = -0.5 * np.einsum("pi,pi->p", t, q[:, 1:])
    vector = 0.5 * (q[:, :1] * t + np.cross(t, q[:, 1:]))
    return q, np.column_stack([scalar, vector])


def skew(v: Float64Array) -> Any:
    """Matrices (P, 3, 3) of the cross products with vectors (P, 3)."""
    result = np.zeros((len(v), 3, 3))
    result[:, 0, 1], result[:, 0, 2], result[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    result[:, 1, 0], result[:, 2, 0], result[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return result
