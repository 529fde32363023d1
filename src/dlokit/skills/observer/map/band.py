"""Normal equations of a chain of nodes: block pentadiagonal, solved as a band.

A residual that joins nodes at most two apart adds to blocks (i, i), (i + 1, i) and (i + 2, i) of H. With three
coordinates a node that is a band of 8 below the diagonal, so that H x = b costs O(M), not O(M³). The band is stored as
LAPACK's lower form, transposed: what the compiled terms add to is what SciPy solves, without a copy in between.
"""

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
        # LAPACK itself: `solveh_banded` around it takes a third of the time again, at eight solutions a cloud.
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

    By Takahashi's recursion, which computes only what lies within the band: for 50 nodes and with the factor 36 µs,
    where `scipy.linalg.cho_solve_banded` on the identity takes 540 µs and `numpy.linalg.inv` 370.
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
