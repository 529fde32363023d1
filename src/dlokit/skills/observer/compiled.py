"""The compiled steps of the Gaussian mixture and of the self-organising map; symbols as in `mixture` and `som`.

The E-step takes one pass over the points and keeps nothing of size N x M. The points are cut into blocks that fit the
processor's nearest cache. For each block, the step computes the Gaussians of one node after another at all points,
divides them by their sum, and sums them. It skips nodes that cannot affect a block: see `expectation`. All sums are in
float64.

The M-step solves the equation of `mixture.CoherentMotion`.
"""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

from math import inf, log, pi

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dlokit.types.arrays import Float64Array, Int64Array

BLOCK = 64
"""Number of points in a block: the exponentials of 50 nodes then take 25 kB."""
NEGLIGIBLE = 41.0
"""exp(-41) = 1.6e-18: omitting a hundred nodes changes a probability by less than its last digit."""
_SMALLEST = np.finfo(np.float64).tiny

_LOG2_E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_TO_INTEGER = 1.5 * 2.0**52  # adding it leaves the rounded number in the lowest bits


def sorted_blocks(X: Float64Array, axis: Float64Array) -> tuple[Float64Array, Float64Array]:
    """The points (N, 3) in order along an `axis` (3,), as (3, N), and the corners of their blocks' boxes (B, 2, 3).

    Sorted points make blocks that are short along the axis, with few nodes near each.
    """
    columns = np.ascontiguousarray(X[np.argsort(X @ axis)].T)
    first = np.arange(0, len(X), BLOCK)
    lower, upper = np.minimum.reduceat(columns, first, axis=1), np.maximum.reduceat(columns, first, axis=1)
    return columns, np.ascontiguousarray(np.stack([lower.T, upper.T], axis=1))


@njit(cache=True)
def expectation(
    columns: Float64Array, boxes: Float64Array, T: Float64Array, sigma2: float, outlier_weight: float
) -> tuple[Float64Array, Float64Array, float]:
    """The E-step, eq. 6, with the sums over P that the M-step needs: P 1 (M,), P X (M, 3) and tr Xᵀ d(Pᵀ1) X.

    p_mn = exp(-|x_n - t_m|² / 2 sigma²) / (sum_k exp(-|x_n - t_k|² / 2 sigma²) + c),
    c = (2 pi sigma²)^(3/2) w / (1 - w) M / N. `columns` and `boxes` are from `sorted_blocks`.

    A Gaussian below exp(-41) c changes no sum: nodes at that distance from a block's box are skipped. Without outliers,
    c = 0, no node is skipped. A point at which all Gaussians are below 1e-304 belongs to no node.
    """
    N, M = columns.shape[1], len(T)
    c = (2.0 * pi * sigma2) ** 1.5 * outlier_weight / (1.0 - outlier_weight) * M / N
    reach = 2.0 * sigma2 * (NEGLIGIBLE - log(c)) if c > 0.0 else inf
    exponentials, near = np.empty((M, BLOCK)), np.empty(M, dtype=np.int64)
    total, inverse = np.empty(BLOCK), np.empty(BLOCK)
    P1, PX, squares = np.zeros(M), np.zeros((M, 3)), 0.0
    for block in range(len(boxes)):
        first, last = block * BLOCK, min((block + 1) * BLOCK, N)
        size = last - first
        x, y, z = columns[0, first:last], columns[1, first:last], columns[2, first:last]
        count = _nodes_near(T, boxes[block], reach, near)
        total[:] = 0.0
        for row in range(count):
            m = near[row]
            _add_gaussian(exponentials[row, :size], total, x, y, z, T[m, 0], T[m, 1], T[m, 2], -0.5 / sigma2)
        for n in range(size):
            inverse[n] = 1.0 / max(total[n] + c, _SMALLEST)
            squares += total[n] * inverse[n] * (x[n] ** 2 + y[n] ** 2 + z[n] ** 2)
        for row in range(count):
            m = near[row]
            sums = _weighted_sums(exponentials[row, :size], inverse, x, y, z)
            P1[m] += sums[0]
            PX[m, 0] += sums[1]
            PX[m, 1] += sums[2]
            PX[m, 2] += sums[3]
    return P1, PX, squares


@njit(cache=True)
def _nodes_near(T: Float64Array, box: Float64Array, reach: float, near: NDArray[np.int64]) -> int:
    """Write the nodes whose squared distance to the box is below `reach` into `near` (M,); return their number."""
    count = 0
    for m in range(len(T)):
        squared = 0.0
        for k in range(3):
            off = max(box[0, k] - T[m, k], T[m, k] - box[1, k], 0.0)
            squared += off * off
        if squared < reach:
            near[count] = m
            count += 1
    return count


# `contract` allows a * b + c in one instruction, nothing else: the sums of `_exp` must keep their order.
@njit(cache=True, fastmath={"contract"})
def _add_gaussian(
    into: Float64Array,
    total: Float64Array,
    x: Float64Array,
    y: Float64Array,
    z: Float64Array,
    tx: float,
    ty: float,
    tz: float,
    factor: float,
) -> None:
    """Write exp(factor |x_n - t|²) of one node for all points of a block into `into`, and add it to `total`."""
    for n in range(len(into)):
        dx, dy, dz = x[n] - tx, y[n] - ty, z[n] - tz
        value = _exp((dx * dx + dy * dy + dz * dz) * factor)
        into[n] = value
        total[n] += value


# `reassoc` allows partial sums, so that they are taken eight points at a time; NaN stays NaN.
@njit(cache=True, fastmath={"contract", "reassoc"})
def _weighted_sums(
    weight: Float64Array, inverse: Float64Array, x: Float64Array, y: Float64Array, z: Float64Array
) -> tuple[float, float, float, float]:
    """The sums of the posteriors of one node over a block, and of the points weighted by them."""
    p1 = px = py = pz = 0.0
    for n in range(len(weight)):
        p = weight[n] * inverse[n]
        p1 += p
        px += p * x[n]
        py += p * y[n]
        pz += p * z[n]
    return p1, px, py, pz


@njit(cache=True, fastmath={"contract"}, inline="always")
def _exp(v: float) -> float:
    """exp(v) for v <= 0 to two units in the last place, 0 below exp(-700), without branches or calls.

    v = k ln 2 + r with |r| <= ln 2 / 2; exp(r) by its series to r^12 / 12!, whose rest is 2e-16; 2^k by its bits.
    The compiler vectorises it, unlike `np.exp`: the E-step of 2,000 points and 50 nodes takes 0.24 to 0.31 of the time
    (101 against 415 µs at sigma = 36 mm, 23 against 74 µs at 3 mm).
    """
    bounded = max(v, -700.0)
    shifted = bounded * _LOG2_E + _TO_INTEGER
    k = shifted - _TO_INTEGER
    r = (bounded - k * _LN2_HIGH) - k * _LN2_LOW
    series = 1.0 / 479001600.0
    series = series * r + 1.0 / 39916800.0
    series = series * r + 1.0 / 3628800.0
    series = series * r + 1.0 / 362880.0
    series = series * r + 1.0 / 40320.0
    series = series * r + 1.0 / 5040.0
    series = series * r + 1.0 / 720.0
    series = series * r + 1.0 / 120.0
    series = series * r + 1.0 / 24.0
    series = series * r + 1.0 / 6.0
    series = series * r + 0.5
    series = series * r + 1.0
    series = series * r + 1.0
    bits = (np.float64(shifted).view(np.int64) + np.int64(1023)) << np.int64(52)
    power = np.int64(bits).view(np.float64)
    return series * power if v > -700.0 else 0.0


@njit(cache=True)
def coherent_nodes(
    Y: Float64Array,
    L: Float64Array,
    stiff: Float64Array,
    strained: Float64Array,
    P1: Float64Array,
    PX: Float64Array,
    ridge: float,
    stiffness: float,
) -> Float64Array:
    """T (M, 3), by the system of `CoherentMotion`. Raises `numpy.linalg.LinAlgError` when it has not one solution."""
    M, r = L.shape
    A, c = stiffness * stiff, -stiffness * strained
    for m in range(M):
        for i in range(r):
            weighted = P1[m] * L[m, i]
            for j in range(r):
                A[i, j] += weighted * L[m, j]
            for k in range(3):
                c[i, k] += L[m, i] * (PX[m, k] - P1[m] * Y[m, k])
    for i in range(r):
        A[i, i] += ridge
    return Y + L @ np.linalg.solve(A, c)


@njit(cache=True)
def winners(X: Float64Array, T: Float64Array) -> tuple[Int64Array, Float64Array]:
    """Each point's nearest neuron (N,), c(n) = argmin_j |x_n - t_j|, and its distance (N,) [m].

    Every pair is compared: for 700 points and 50 neurons, 40 times a cloud, that takes 0.3 of the time of
    `scipy.spatial.KDTree` (31 against 107 µs).
    """
    winner, distance_m = np.zeros(len(X), dtype=np.int64), np.empty(len(X))
    for n in range(len(X)):
        nearest = np.inf
        for j in range(len(T)):
            dx, dy, dz = X[n, 0] - T[j, 0], X[n, 1] - T[j, 1], X[n, 2] - T[j, 2]
            squared = dx * dx + dy * dy + dz * dz
            if squared < nearest:
                nearest = squared
                winner[n] = j
        distance_m[n] = np.sqrt(nearest)
    return winner, distance_m
