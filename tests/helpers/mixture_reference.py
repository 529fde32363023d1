"""The E-step of a mixture, written as its equation: the reference for the compiled one."""

import numpy as np

from dlokit.types.arrays import Float64Array


def expectation(
    X: Float64Array, T: Float64Array, sigma2: float, outlier_weight: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """P 1 (M,), Pᵀ 1 (N,) and P X (M, 3) of eq. 6, from all distances between points (N, 3) and nodes (M, 3)."""
    (N, D), M = X.shape, len(T)
    likely = np.exp(np.sum((T[:, None] - X[None]) ** 2, axis=2) / (-2.0 * sigma2))
    c = (2.0 * np.pi * sigma2) ** (D / 2) * outlier_weight / (1.0 - outlier_weight) * M / N
    P = likely / np.maximum(likely.sum(axis=0) + c, np.finfo(np.float64).tiny)
    return P.sum(axis=1), P.sum(axis=0), P @ X
