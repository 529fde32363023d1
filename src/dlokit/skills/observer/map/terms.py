"""The normal equations H x = b of a chain of nodes, and the terms that add their Gauss-Newton parts to them.

A residual that joins nodes at most two apart adds to blocks (i, i), (i + 1, i) and (i + 2, i) of H. With three
coordinates a node that is a band of 8 below the diagonal, so that H x = b costs O(M), not O(M³). The band is stored as
LAPACK's lower form, transposed: SciPy solves the system in place, without a copy of the compiled terms' result.

Symbols: x_i the nodes, y_i the previous nodes, moved rigidly, d_i = x_i - y_i, l_j the rest length of
edge j, h the mean edge, u_j the unit vector along edge j, I the identity. A residual r with standard deviation
sigma adds Jᵀ J / sigma² to H; since every residual here is written as J x - target, b gets Jᵀ target / sigma².
H x - b is then the gradient of half the sum of squares (tested against finite differences).
"""

from functools import lru_cache

import numpy as np
import scipy
from numba import njit

from dlokit.types.arrays import Float64Array

BELOW = 8
"""Diagonals below the main one: 3 coordinates times 2 nodes plus 2."""


class ChainSystem:
    """H x = b over the nodes of a chain; terms add to it."""

    def __init__(self, count: int) -> None:
        """`count` M nodes, all zero."""
        self.band: Float64Array = np.zeros((3 * count, BELOW + 1))
        """(3 M, 9): entry [c, k] is H[c + k, c], k at most 8."""
        self.rhs: Float64Array = np.zeros((count, 3))
        """(M, 3): b."""

    def solve(self) -> Float64Array:
        """x (M, 3). Raises `numpy.linalg.LinAlgError` unless H is positive definite: every node needs some term."""
        # LAPACK directly: its wrapper `solveh_banded` adds a third to the time, at eight solutions per cloud.
        _, x, failed = scipy.linalg.lapack.dpbsv(self.band.T, self.rhs.reshape(-1), lower=1)
        if failed:
            raise np.linalg.LinAlgError(f"the normal equations of {len(self.rhs)} nodes have not one solution")
        return x.reshape(-1, 3)

    def covariance(self) -> Float64Array:
        """The diagonal blocks of H⁻¹, (M, 3, 3): each node's covariance. Raises as `solve` does."""
        return inverse_blocks(scipy.linalg.cholesky_banded(self.band.T, lower=True, check_finite=False).T)


@njit(cache=True)
def add_block(band: Float64Array, row: int, column: int, scale: float, block: Float64Array) -> None:
    """H += scale * `block` (3, 3) at nodes (row, column), row >= column; of a diagonal block the lower half."""
    for p in range(3):
        r = 3 * row + p
        for q in range(3):
            c = 3 * column + q
            if c <= r:
                band[c, r - c] += scale * block[p, q]


@njit(cache=True)
def inverse_blocks(factor: Float64Array) -> Float64Array:
    """The diagonal blocks of H⁻¹ (M, 3, 3) from L, H = L Lᵀ, stored as H is (3 M, 9).

    By Takahashi's recursion, which computes only entries within the band: 36 µs for 50 nodes, including the factor;
    `scipy.linalg.cho_solve_banded` on the identity takes 540 µs and `numpy.linalg.inv` 370 µs.
    """
    n = factor.shape[0]
    inverse = np.zeros(factor.shape)
    for i in range(n - 1, -1, -1):
        last = min(i + BELOW, n - 1)
        for j in range(last, i - 1, -1):
            total = 0.0
            for k in range(i + 1, last + 1):
                low, high = min(j, k), max(j, k)
                total += factor[i, k - i] * inverse[low, high - low]
            own = 1.0 / factor[i, 0] if i == j else 0.0
            inverse[i, j - i] = (own - total) / factor[i, 0]
    blocks = np.empty((n // 3, 3, 3))
    for node in range(n // 3):
        for p in range(3):
            for q in range(p + 1):
                r, c = 3 * node + p, 3 * node + q
                blocks[node, p, q] = blocks[node, q, p] = inverse[c, r - c]
    return blocks


STRAIN_PER_M05 = 8.0
"""Incoherence: nodes s apart move differently by this times sqrt(s), times the distance travelled [m^-0.5]."""
BEND_PER_M15 = 15.0
"""Change of bend: a stretch s leaves its old shape by this times s^1.5, times the distance travelled [m^-1.5]."""
STRAIGHT_PER_M05 = 20.0
"""The rod's own bend: a stretch s leaves a straight line by about this times s^1.5 [m^-0.5]; weak."""
_BELOW_M = 1e-6  # smaller depths below the table do not count


@lru_cache(maxsize=8)
def coherence(count: int, step_m: float) -> tuple[Float64Array, Float64Array]:
    """K_d and K_x of the quadratic forms dᵀ K_d d and xᵀ K_x x, the same for each coordinate, as bands (M, 3).

    sum |d_{i+1} - d_i|² / (strain² h) + sum |d_{i+1} - 2 d_i + d_{i-1}|² / (bend² h³), for a motion of 1 m since the
    last cloud, and sum |x_{i+1} - 2 x_i + x_{i-1}|² / (straight² h³). The powers of h make them independent of M.
    Entry [i, k] of a band is K[i, i - k].
    """
    D1 = np.diff(np.eye(count), axis=0)
    D2 = np.diff(D1, axis=0)
    bends = D2.T @ D2 / step_m**3
    K_d = D1.T @ D1 / (STRAIN_PER_M05**2 * step_m) + bends / BEND_PER_M15**2
    return _lower_band(K_d), _lower_band(bends / STRAIGHT_PER_M05**2)


def _lower_band(K: Float64Array) -> Float64Array:
    band = np.zeros((len(K), 3))
    for k in range(3):
        band[k:, k] = np.diagonal(K, -k)
    return band


@njit(cache=True)
def add_coherence(
    band: Float64Array, rhs: Float64Array, before: Float64Array, K: Float64Array, K_x: Float64Array
) -> None:
    """Motion coherence and bending: H += (K + K_x) ⊗ I and b += K y, y `before` (M, 3) [m]; K, K_x as bands (M, 3)."""
    for i in range(K.shape[0]):
        for k in range(min(i, 2) + 1):
            for axis in range(3):
                band[3 * (i - k) + axis, 3 * k] += K[i, k] + K_x[i, k]
                rhs[i, axis] += K[i, k] * before[i - k, axis]
                if k > 0:
                    rhs[i - k, axis] += K[i, k] * before[i, axis]


@njit(cache=True)
def add_lengths(
    band: Float64Array, rhs: Float64Array, nodes: Float64Array, rest_m: Float64Array, sigma_m: float
) -> None:
    """Rest lengths: r_j = u_jᵀ (x_{j+1} - x_j) - l_j, which is |x_{j+1} - x_j| - l_j at `nodes` (M, 3) [m]."""
    block, weight = np.empty((3, 3)), 1.0 / sigma_m**2
    for j in range(nodes.shape[0] - 1):
        u = direction(nodes, j)
        for p in range(3):
            for q in range(3):
                block[p, q] = u[p] * u[q]
            pull = u[p] * rest_m[j] * weight
            rhs[j, p] -= pull
            rhs[j + 1, p] += pull
        add_block(band, j, j, weight, block)
        add_block(band, j + 1, j + 1, weight, block)
        add_block(band, j + 1, j, -weight, block)


@njit(cache=True)
def direction(nodes: Float64Array, j: int) -> tuple[float, float, float]:
    """The unit vector u_j along edge j of `nodes` (M, 3)."""
    a = nodes[j + 1, 0] - nodes[j, 0]
    b = nodes[j + 1, 1] - nodes[j, 1]
    c = nodes[j + 1, 2] - nodes[j, 2]
    length = max(np.sqrt(a * a + b * b + c * c), 1e-9)
    return a / length, b / length, c / length


@njit(cache=True)
def add_places(band: Float64Array, rhs: Float64Array, weights: Float64Array, sums: Float64Array, scale: float) -> None:
    """Pull nodes to places: scale w_i (x_i - a_i), with `weights` w (M,) [1/m²] and `sums` w a (M, 3) [1/m]."""
    for i in range(weights.shape[0]):
        for axis in range(3):
            band[3 * i + axis, 0] += scale * weights[i]
            rhs[i, axis] += scale * sums[i, axis]


@njit(cache=True)
def add_points(band: Float64Array, rhs: Float64Array, nodes: Float64Array, moments: Float64Array) -> None:
    """Distances of points p_n to their segments: r_n = N_j (p_n - (1 - t_n) x_j - t_n x_{j+1}).

    N_j = I - u_j u_jᵀ removes the part along the segment, so that nodes are free to slide: a point constrains the
    line of the rod and not the position along it. Row j of `moments` (M - 1, 9) has the sums of w, w t, w t², w p and
    w t p over the points of segment j; w [1/m²] includes the robust weight.
    """
    normal = np.empty((3, 3))
    for j in range(moments.shape[0]):
        w0, w1, w2 = moments[j, 0], moments[j, 1], moments[j, 2]
        if w0 <= 0.0:
            continue
        u = direction(nodes, j)
        for p in range(3):
            for q in range(3):
                normal[p, q] = (1.0 if p == q else 0.0) - u[p] * u[q]
        add_block(band, j, j, w0 - 2.0 * w1 + w2, normal)
        add_block(band, j + 1, j + 1, w2, normal)
        add_block(band, j + 1, j, w1 - w2, normal)
        for p in range(3):
            for q in range(3):
                rhs[j, p] += normal[p, q] * (moments[j, 3 + q] - moments[j, 6 + q])
                rhs[j + 1, p] += normal[p, q] * moments[j, 6 + q]


@njit(cache=True)
def add_place(band: Float64Array, rhs: Float64Array, node: int, place: Float64Array, sigma_m: float) -> None:
    """Keep a node at a place (3,) [m] that is known in all directions, as in a gripper: r = x_i - place."""
    for axis in range(3):
        band[3 * node + axis, 0] += 1.0 / sigma_m**2
        rhs[node, axis] += place[axis] / sigma_m**2


@njit(cache=True)
def add_tip(band: Float64Array, rhs: Float64Array, nodes: Float64Array, end: int, inner: int, sigma_m: float) -> None:
    """Keep a tip's position along the rod: r = uᵀ (x_end - now), u the direction from node `inner`.

    `band` (3 M, 9) and `rhs` (M, 3) are added to; `nodes` (M, 3) [m].
    """
    along = nodes[end] - nodes[inner]
    along /= max(np.sqrt(np.sum(along**2)), 1e-9)
    at = along[0] * nodes[end, 0] + along[1] * nodes[end, 1] + along[2] * nodes[end, 2]
    block = np.empty((3, 3))
    for p in range(3):
        for q in range(3):
            block[p, q] = along[p] * along[q]
        rhs[end, p] += along[p] * at / sigma_m**2
    add_block(band, end, end, 1.0 / sigma_m**2, block)


@njit(cache=True)
def add_table(band: Float64Array, rhs: Float64Array, nodes: Float64Array, height_m: float, sigma_m: float) -> None:
    """The table as a half-space: r_i = z_i - height for `nodes` (M, 3) [m] below it, and no term for nodes above.

    Nodes at rest are exactly at the height, and rounding must not decide whether they are below: the threshold is 1 µm.
    """
    for i in range(nodes.shape[0]):
        if nodes[i, 2] < height_m - _BELOW_M:
            band[3 * i + 2, 0] += 1.0 / sigma_m**2
            rhs[i, 2] += height_m / sigma_m**2
