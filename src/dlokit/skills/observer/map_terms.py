"""What a rod is held to, term by term: each adds its Gauss-Newton part to the normal equations H x = b.

Symbols: x_i the nodes, y_i the nodes before, moved rigidly (`map_align`), d_i = x_i - y_i, l_j the rest length of
edge j, h the mean edge, u_j the unit vector along edge j, I the identity. A residual r with standard deviation
sigma adds Jᵀ J / sigma² to H; since every residual here is written as J x - target, b gets Jᵀ target / sigma².
H x - b is then the gradient of half the sum of squares (tested against finite differences).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map_solver import ChainSystem

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class ChainPriors:
    """How much a rod may differ from what it was, whatever the cloud says."""

    length_m: float = 0.0001
    """Standard deviation of an edge from its rest length [m]: a rod hardly stretches."""
    strain_per_m05: float = 4.0
    """Incoherence: nodes s apart move differently by this times sqrt(s), times the way since then [m^-0.5]."""
    bend_per_m15: float = 15.0
    """Change of bend: a stretch s leaves its old shape by this times s^1.5, times the way since then [m^-1.5]."""
    straight_per_m05: float = 20.0
    """The rod's own bend: a stretch s leaves a straight line by about this times s^1.5 [m^-0.5]; weak."""
    place_m: float = 0.3
    """A node stays within this of where it was [m]; so weak that it only decides where nothing else does."""
    pin_m: float = 0.0001
    """Standard deviation of a held node from its gripper [m]."""
    tip_m: float = 0.001
    """Standard deviation of a seen tip from the end of the cloud, along the rod [m]."""
    table_m: float = 0.0001
    """How far a node may sink into the table [m]."""


@lru_cache(maxsize=8)
def coherence(count: int, step_m: float, priors: ChainPriors) -> tuple[Array, Array]:
    """K_d and K_x (M, M) of the quadratic forms dᵀ K_d d and xᵀ K_x x, the same for each coordinate.

    sum |d_{i+1} - d_i|² / (strain² h) + sum |d_{i+1} - 2 d_i + d_{i-1}|² / (bend² h³), for a way of 1 m since the
    last cloud, and sum |x_{i+1} - 2 x_i + x_{i-1}|² / (straight² h³). The powers of h make them independent of M.
    """
    D1 = np.diff(np.eye(count), axis=0)
    D2 = np.diff(D1, axis=0)
    bends = D2.T @ D2 / step_m**3
    K_d = D1.T @ D1 / (priors.strain_per_m05**2 * step_m) + bends / priors.bend_per_m15**2
    return K_d, bends / priors.straight_per_m05**2


def add_coherence(system: ChainSystem, before: Array, step_m: float, way_m: float, priors: ChainPriors) -> None:
    """Motion coherence and bending: H += (K + K_x) ⊗ I and b += K y, y `before` (M, 3) [m].

    K = K_d / way² + I / (M place²): what moved far may also have changed its shape.
    """
    unit, K_x = coherence(len(before), step_m, priors)
    K_d = unit / way_m**2
    K_d[np.diag_indices(len(before))] += 1.0 / (len(before) * priors.place_m**2)
    K = K_d + K_x
    for axis in range(3):
        system.diagonal[:, axis, axis] += np.diagonal(K)
        system.first[:, axis, axis] += np.diagonal(K, -1)
        system.second[:, axis, axis] += np.diagonal(K, -2)
    system.rhs += K_d @ before


def add_lengths(system: ChainSystem, nodes: Array, rest_m: Array, sigma_m: float) -> None:
    """Rest lengths: r_j = u_jᵀ (x_{j+1} - x_j) - l_j, which is |x_{j+1} - x_j| - l_j at `nodes` (M, 3) [m]."""
    edge = np.diff(nodes, axis=0)
    u = edge / np.maximum(np.sqrt(np.sum(edge**2, axis=1)), 1e-9)[:, None]
    blocks = (u[:, :, None] * u[:, None, :]) / sigma_m**2
    system.diagonal[:-1] += blocks
    system.diagonal[1:] += blocks
    system.first -= blocks
    pull = u * (rest_m / sigma_m**2)[:, None]
    system.rhs[:-1] -= pull
    system.rhs[1:] += pull


def add_places(system: ChainSystem, weights: Array, sums: Array) -> None:
    """Nodes drawn to places: w_i (x_i - a_i), with `weights` w (M,) [1/m²] and `sums` w a (M, 3) [1/m]."""
    for axis in range(3):
        system.diagonal[:, axis, axis] += weights
    system.rhs += sums


def add_points(system: ChainSystem, nodes: Array, points: Array, segment: Indices, t: Array, weights: Array) -> None:
    """Distances of points p_n to their segments: r_n = N_j (p_n - (1 - t_n) x_j - t_n x_{j+1}).

    N_j = I - u_j u_jᵀ takes the part along the segment away, so that nodes are free to slide: a point says where
    the rod runs and not where along it. `segment` j and `t` (N,), `weights` (N,) [1/m²] with the robust part in.
    """
    count = len(nodes) - 1
    edge = np.diff(nodes, axis=0)
    u = edge / np.maximum(np.sqrt(np.sum(edge**2, axis=1)), 1e-9)[:, None]
    normal = np.eye(3) - u[:, :, None] * u[:, None, :]
    wt = weights * t
    w0 = np.bincount(segment, weights, count)
    w1 = np.bincount(segment, wt, count)
    w2 = np.bincount(segment, wt * t, count)
    p0, p1 = (
        np.column_stack([np.bincount(segment, w * points[:, axis], count) for axis in range(3)]) for w in (weights, wt)
    )
    system.diagonal[:-1] += (w0 - 2.0 * w1 + w2)[:, None, None] * normal
    system.diagonal[1:] += w2[:, None, None] * normal
    system.first += (w1 - w2)[:, None, None] * normal
    system.rhs[:-1] += np.matmul(normal, (p0 - p1)[:, :, None])[:, :, 0]
    system.rhs[1:] += np.matmul(normal, p1[:, :, None])[:, :, 0]


def add_place(system: ChainSystem, node: int, place: Array, sigma_m: float) -> None:
    """A node at a place (3,) [m] that is known in all directions, as in a gripper: r = x_i - place."""
    system.diagonal[node] += np.eye(3) / sigma_m**2
    system.rhs[node] += place / sigma_m**2


def add_along(system: ChainSystem, node: int, place: Array, direction: Array, sigma_m: float) -> None:
    """A node whose place (3,) [m] is known along a unit `direction` (3,): r = directionᵀ (x_i - place)."""
    system.diagonal[node] += np.outer(direction, direction) / sigma_m**2
    system.rhs[node] += direction * (direction @ place / sigma_m**2)


def add_table(system: ChainSystem, nodes: Array, height_m: float, sigma_m: float) -> None:
    """The table as a half-space: r_i = z_i - height where `nodes` (M, 3) [m] lie below it, else nothing."""
    under = nodes[:, 2] < height_m
    system.diagonal[under, 2, 2] += 1.0 / sigma_m**2
    system.rhs[under, 2] += height_m / sigma_m**2
