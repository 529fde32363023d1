"""A Gaussian mixture whose centroids are the nodes, fitted to a cloud: what CPD and SPR have in common.

Myronenko, Song: *Point Set Registration: Coherent Point Drift*, TPAMI 32 (2010), doi 10.1109/TPAMI.2010.46.
Symbols as there: X (N, D) the cloud, Y (M, D) the nodes before, T = Y + G W the nodes after, P the posterior
probabilities, sigma² the one variance of all Gaussians, w the weight of the uniform outlier class, beta the
width of the kernel G. The methods differ in how the M-step finds W.
"""

# The paper's capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.visibility import VisibilityConfig

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class MixtureConfig:
    """The fit of a mixture whose nodes move coherently."""

    beta_m: float = 0.12
    """Width of the Gaussian kernel [m]: nodes nearer than this move alike."""
    lambda_per_m2: float = 300.0
    """Weight of the smoothness of the motion against the fit [1/m²]."""
    outlier_weight: float = 0.05
    """w, the share of points expected to belong to nothing, from 0 to below 1."""
    initial_sigma_m: float = 0.04
    """Standard deviation of the Gaussians at the start [m]; about the largest motion between two clouds.
    0 takes the paper's, the mean distance of all pairs, for a registration from far."""
    smallest_sigma_m: float = 0.002
    """The iteration ends below this standard deviation [m]; about the noise of the cloud."""
    tolerance: float = 1e-3
    """The iteration ends when sigma² changes by a smaller share than this."""
    max_iterations: int = 60
    """The iteration ends at the latest after so many steps."""
    max_points: int = 700
    """Larger clouds are thinned, evenly over their index, to so many points before registration."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""


@dataclass(frozen=True, kw_only=True)
class MStep:
    """What an M-step starts from."""

    Y: Array
    """The nodes before (M, D) [m], about their centre."""
    G: Array
    """The kernel between them (M, M)."""
    P1: Array
    """P 1 (M,)."""
    PX: Array
    """P X (M, D) [m], about the same centre."""
    sigma2: float
    """The variance that P was found with [m²]."""
    iteration: int
    """0 at the first."""


@dataclass(frozen=True, kw_only=True)
class Registration:
    """The outcome of one fit."""

    nodes: Array
    """T (M, D) [m]."""
    weights: Array
    """P 1 (M,): how many points each node explains."""
    inliers: Array
    """Pᵀ 1 (N,): the probability that a point belongs to the DLO."""
    coefficients: Array
    """W (M, D) [m]: the motion anywhere is v(z) = sum_m exp(-|z - y_m|² / (2 beta²)) w_m, eq. 18 ff."""
    sigma2: Array
    """sigma² before the first and after each iteration (iterations + 1,) [m²]."""


def fit_mixture(X: Array, Y: Array, config: MixtureConfig, m_step: Callable[[MStep], Array]) -> Registration:
    """Move the nodes Y (M, D) [m] onto the cloud X (N, D) [m], N >= 1; the loop of Fig. 4.

    `m_step` gives W (M, D). Then T = Y + G W and
    sigma² = (tr Xᵀ d(Pᵀ1) X - 2 tr (PX)ᵀ T + tr Tᵀ d(P1) T) / (N_P D).
    """
    origin = Y.mean(axis=0)  # distances by products lose digits far from the origin
    X, Y = X - origin, Y - origin
    G = kernel(Y, config.beta_m)
    D = X.shape[1]
    T, W = Y, np.zeros_like(Y)
    start = initial_sigma2(X, Y) if config.initial_sigma_m == 0 else config.initial_sigma_m**2
    sigma2 = [start]
    squares = np.sum(X**2, axis=1)
    P1, Pt1, PX = expectation(X, T, start, config.outlier_weight)
    for iteration in range(config.max_iterations):
        W = m_step(MStep(Y=Y, G=G, P1=P1, PX=PX, sigma2=sigma2[-1], iteration=iteration))
        T = Y + G @ W
        explained = max(float(P1.sum()), np.finfo(np.float64).tiny)
        misfit = Pt1 @ squares - 2.0 * np.sum(PX * T) + P1 @ np.sum(T**2, axis=1)
        sigma2.append(max(float(misfit) / (explained * D), config.smallest_sigma_m**2 / 4))
        P1, Pt1, PX = expectation(X, T, sigma2[-1], config.outlier_weight)
        settled = abs(sigma2[-2] - sigma2[-1]) < config.tolerance * sigma2[-2]
        if settled or sigma2[-1] < config.smallest_sigma_m**2:
            break
    return Registration(nodes=T + origin, weights=P1, inliers=Pt1, coefficients=W, sigma2=np.array(sigma2))


def expectation(X: Array, T: Array, sigma2: float, outlier_weight: float) -> tuple[Array, Array, Array]:
    """The E-step, eq. 6, with the three products of P that the M-step needs, without keeping P.

    p_mn = exp(-|x_n - t_m|² / 2 sigma²) / (sum_k exp(-|x_n - t_k|² / 2 sigma²) + c),
    c = (2 pi sigma²)^(D/2) w / (1 - w) M / N. Returns P 1 (M,), Pᵀ 1 (N,) and P X (M, D).
    """
    (N, D), M = X.shape, len(T)
    P = squared_distances(T, X)
    P *= -0.5 / sigma2
    np.exp(P, out=P)
    c = (2.0 * np.pi * sigma2) ** (D / 2) * outlier_weight / (1.0 - outlier_weight) * M / N
    near = P.sum(axis=0)
    share = 1.0 / np.maximum(near + c, np.finfo(np.float64).tiny)
    return P @ share, near * share, P @ (X * share[:, None])


def kernel(Y: Array, beta_m: float) -> Array:
    """G (M, M) with g_ij = exp(-|y_i - y_j|² / (2 beta²)), eq. 16 ff."""
    return np.exp(squared_distances(Y, Y) / (-2.0 * beta_m**2))


def initial_sigma2(X: Array, Y: Array) -> float:
    """The mean over all pairs of |x_n - y_m|² / D, the initialisation of Fig. 4 [m²]."""
    spread = np.mean(np.sum(X**2, axis=1)) + np.mean(np.sum(Y**2, axis=1)) - 2.0 * X.mean(axis=0) @ Y.mean(axis=0)
    return float(spread) / X.shape[1]


def motion(places: Array, Y: Array, result: Registration, beta_m: float) -> Array:
    """How the registration of the nodes Y moves other places (K, D) [m]: the displacement (K, D) [m]."""
    return np.exp(squared_distances(places - Y.mean(axis=0), Y - Y.mean(axis=0)) / (-2.0 * beta_m**2)) @ (
        result.coefficients
    )


def thinned(points: Array, count: int) -> Array:
    """At most `count` of the points, spread evenly over their index."""
    if len(points) <= count:
        return points
    return points[np.linspace(0, len(points) - 1, count).astype(np.int64)]


def squared_distances(A: Array, B: Array) -> Array:
    """|a_i - b_j|² (len(A), len(B)), from the products of the points."""
    squared = A @ B.T
    squared *= -2.0
    squared += np.sum(A**2, axis=1)[:, None]
    squared += np.sum(B**2, axis=1)
    return np.maximum(squared, 0.0, out=squared)
