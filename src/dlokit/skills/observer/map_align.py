"""The rigid part of a motion, so that only the rest of it counts against coherence."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def moved_rigidly(before: Array, after: Array, weights: Array) -> Array:
    """`before` (M, 3) [m] turned and shifted to lie on `after` (M, 3) [m], by weights (M,), their sum above 0.

    R maximises tr(Rᵀ (C + kappa I)), C = sum w (after - mean) (before - mean)ᵀ (Kabsch). A straight rod does not
    tell its roll; kappa, a hundredth of tr C's bound, then makes R the smallest turn.
    """
    w = weights / np.sum(weights)
    centre_b, centre_a = w @ before, w @ after
    b, a = before - centre_b, after - centre_a
    C = (a * w[:, None]).T @ b
    spread = float(np.sum(w @ b**2))
    U, _, Vt = np.linalg.svd(C + 0.01 * spread * np.eye(3))
    U[:, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt)) or 1.0
    return b @ (U @ Vt).T + centre_a
