"""The rigid part of a motion, so that only the rest of it counts against coherence."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def moved_rigidly(before: Array, after: Array, weights: Array) -> Array:
    """`before` (M, 3) [m] turned and shifted to lie on `after` (M, 3) [m], by weights (M,), their sum above 0.

    R maximises tr(Rᵀ (C + kappa I)), C = sum w (after - mean) (before - mean)ᵀ (Kabsch). A straight rod does not
    tell its roll; kappa, a hundredth of tr C's bound, then makes R the smallest turn.
    """
    total = np.sum(weights)
    centre_b, centre_a = np.zeros(3), np.zeros(3)
    for i in range(before.shape[0]):
        for axis in range(3):
            centre_b[axis] += weights[i] * before[i, axis] / total
            centre_a[axis] += weights[i] * after[i, axis] / total
    C, spread = np.zeros((3, 3)), 0.0
    for i in range(before.shape[0]):
        for p in range(3):
            b = before[i, p] - centre_b[p]
            spread += weights[i] / total * b * b
            for q in range(3):
                C[q, p] += weights[i] / total * (after[i, q] - centre_a[q]) * b
    for axis in range(3):
        C[axis, axis] += 0.01 * spread
    U, _, Vt = np.linalg.svd(C)
    if np.linalg.det(U) * np.linalg.det(Vt) < 0.0:
        U[:, 2] *= -1.0
    R = U @ Vt
    moved = np.empty_like(before)
    for i in range(before.shape[0]):
        for p in range(3):
            moved[i, p] = centre_a[p]
            for q in range(3):
                moved[i, p] += R[p, q] * (before[i, q] - centre_b[q])
    return moved
