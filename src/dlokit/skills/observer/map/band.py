"""Normal equations of a chain of nodes: block pentadiagonal, solved as a band.

A residual that joins nodes at most two apart adds to blocks (i, i), (i + 1, i) and (i + 2, i) of H. With three
coordinates a node that is a band of 8 below the diagonal, so that H x = b costs O(M), not O(M³).
"""

import numpy as np
from numba import njit

from dlokit.types.arrays import Float64Array

BELOW = 8
"""Diagonals below the main one: 3 coordinates times 2 nodes plus 2."""


class ChainSystem:
    """H x = b over the nodes of a chain; terms add to it."""

    def __init__(self, count: int) -> None:
        """`count` M nodes, all zero."""
        self.band: Float64Array = np.zeros((3 * count, BELOW + 1))
        """(3 M, 9): entry [r, 8 - k] is H[r, r - k], k at most 8."""
        self.rhs: Float64Array = np.zeros((count, 3))
        """(M, 3): b."""

    def solve(self) -> Float64Array:
        """x (M, 3). H must be positive definite: every node needs some term."""
        return solve(self.band, self.rhs)

    def covariance(self) -> Float64Array:
        """The diagonal blocks of H⁻¹, (M, 3, 3): each node's covariance."""
        return inverse_blocks(self.band)


@njit(cache=True)
def add_block(band: Float64Array, row: int, column: int, scale: float, block: Float64Array) -> None:
    """H += scale * `block` (3, 3) at nodes (row, column), row >= column; of a diagonal block the lower half."""
    for p in range(3):
        r = 3 * row + p
        for q in range(3):
            c = 3 * column + q
            if c <= r:
                band[r, BELOW - r + c] += scale * block[p, q]


@njit(cache=True)
def factorised(band: Float64Array) -> Float64Array:
    """The Cholesky factor L of H, H = L Lᵀ, both (3 M, 9) in the storage by bands."""
    factor = np.zeros_like(band)
    for i in range(band.shape[0]):
        first = max(0, i - BELOW)
        for j in range(first, i + 1):
            rest = band[i, BELOW - i + j]
            for k in range(max(first, j - BELOW), j):
                rest -= factor[i, BELOW - i + k] * factor[j, BELOW - j + k]
            if i == j:
                factor[i, BELOW] = np.sqrt(rest)
            else:
                factor[i, BELOW - i + j] = rest / factor[j, BELOW]
    return factor


@njit(cache=True)
def solve(band: Float64Array, rhs: Float64Array) -> Float64Array:
    """x (M, 3) of H x = b (M, 3)."""
    factor = factorised(band)
    n = band.shape[0]
    x = rhs.copy().reshape(n)
    for i in range(n):
        for k in range(max(0, i - BELOW), i):
            x[i] -= factor[i, BELOW - i + k] * x[k]
        x[i] /= factor[i, BELOW]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, min(n, i + BELOW + 1)):
            x[i] -= factor[k, BELOW - k + i] * x[k]
        x[i] /= factor[i, BELOW]
    return x.reshape(rhs.shape)


@njit(cache=True)
def inverse_blocks(band: Float64Array) -> Float64Array:
    """The diagonal blocks of H⁻¹ (M, 3, 3), by Takahashi's recursion: only what lies within the band is computed."""
    factor = factorised(band)
    n = band.shape[0]
    inverse = np.zeros_like(band)
    for i in range(n - 1, -1, -1):
        last = min(i + BELOW, n - 1)
        for j in range(last, i - 1, -1):
            total = 0.0
            for k in range(i + 1, last + 1):
                low, high = min(j, k), max(j, k)
                total += factor[k, BELOW - k + i] * inverse[high, BELOW - high + low]
            own = 1.0 / factor[i, BELOW] if i == j else 0.0
            inverse[j, BELOW - j + i] = (own - total) / factor[i, BELOW]
    blocks = np.empty((n // 3, 3, 3))
    for node in range(n // 3):
        for p in range(3):
            for q in range(p + 1):
                r, c = 3 * node + p, 3 * node + q
                blocks[node, p, q] = blocks[node, q, p] = inverse[r, BELOW - r + c]
    return blocks
