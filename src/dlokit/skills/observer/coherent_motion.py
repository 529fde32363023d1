"""The M-step of CPD and SPR: nodes that move coherently, solved in as few unknowns as the kernel has ranks.

Symbols as in `mixture` and `spr`. Both solve, for T = Y + G W,

    (d(P1) G + lambda sigma² I + tau sigma² M G) W = P X - d(P1) Y - tau sigma² M Y,

CPD with tau = 0 (eq. 22 times d(P1), so that nodes without points need no division). The Gaussian kernel's eigenvalues
fall so fast that G = L Lᵀ to the last digit with r < M columns. Multiplied by Lᵀ from the left, with c = Lᵀ W:

    (lambda sigma² I + Lᵀ (d(P1) + tau sigma² M) L) c = Lᵀ (P X - d(P1) Y - tau sigma² M Y),   T = Y + L c:

r unknowns in place of M, symmetric and positive definite, so that Cholesky's method solves it.
"""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-15
"""Columns of L end when what is left of G's diagonal, which is 1, is below this: the rounding of G itself."""


class CoherentMotion:
    """The motions that the nodes Y (M, 3) [m] can make, with the kernel G (M, M) and SPR's structure matrix (M, M)."""

    def __init__(self, Y: Array, G: Array, structure: Array | None = None) -> None:
        M = len(Y)
        self._Y = Y
        self._structure = np.zeros((M, M)) if structure is None else structure
        self._L = low_rank(G)
        self._stiff = self._L.T @ self._structure @ self._L
        self._strained = self._L.T @ self._structure @ Y

    def nodes(self, P1: Array, PX: Array, ridge: float, stiffness: float = 0.0) -> Array:
        """T (M, 3) [m] from P 1 (M,) and P X (M, 3) [m]; `ridge` is lambda sigma² > 0, `stiffness` tau sigma².

        Raises `numpy.linalg.LinAlgError` when the ridge is too small for the system to have one solution.
        """
        T, solved = _nodes(self._Y, self._L, self._stiff, self._strained, P1, PX, ridge, stiffness)
        if not solved:
            raise np.linalg.LinAlgError(f"lambda sigma² = {ridge:g} is too small for a solution; it must be above 0.")
        return T

    def coefficients(self, P1: Array, PX: Array, T: Array, ridge: float, stiffness: float = 0.0) -> Array:
        """W (M, 3) of the step that gave T, by the same equation: lambda sigma² W = P X - d(P1) T - tau sigma² M T."""
        return (PX - P1[:, None] * T - stiffness * (self._structure @ T)) / ridge


@njit(cache=True)
def _nodes(
    Y: Array, L: Array, stiff: Array, strained: Array, P1: Array, PX: Array, ridge: float, stiffness: float
) -> tuple[Array, bool]:
    """T (M, 3), and whether the system of `CoherentMotion` was positive definite."""
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
    T = Y.copy()
    solved = _solve_in_place(A, c)
    if solved:
        for m in range(M):
            for i in range(r):
                for k in range(3):
                    T[m, k] += L[m, i] * c[i, k]
    return T, solved


@njit(cache=True, fastmath={"contract", "reassoc"})
def _solve_in_place(A: Array, b: Array) -> bool:
    """Cholesky's method: the solution of A x = b for (r, 3) right sides goes to b; False when A is not definite."""
    r = len(A)
    for i in range(r):
        for j in range(i):
            rest = A[i, j]
            for k in range(j):
                rest -= A[i, k] * A[j, k]
            A[i, j] = rest / A[j, j]
            for k in range(3):
                b[i, k] -= A[i, j] * b[j, k]
        pivot = A[i, i]
        for k in range(i):
            pivot -= A[i, k] * A[i, k]
        if not pivot > 0.0:
            return False
        A[i, i] = np.sqrt(pivot)
        for k in range(3):
            b[i, k] /= A[i, i]
    for i in range(r - 1, -1, -1):
        for k in range(3):
            b[i, k] /= A[i, i]
        for j in range(i):
            for k in range(3):
                b[j, k] -= A[i, j] * b[i, k]
    return True


def low_rank(G: Array) -> Array:
    """L (M, r) with L Lᵀ = G (M, M) to `RANK_TOLERANCE`: Cholesky's method with the largest pivot first."""
    (pstrf,) = get_lapack_funcs(("pstrf",), (G,))
    factor, pivots, rank, _ = pstrf(G, tol=RANK_TOLERANCE, lower=True)
    L = np.zeros((len(G), rank))
    L[pivots - 1] = np.tril(factor)[:, :rank]  # LAPACK counts from 1
    return L
