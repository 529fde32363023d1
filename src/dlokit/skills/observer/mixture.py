"""A Gaussian mixture whose centroids are the nodes, fitted to a cloud: the common part of CPD and SPR.

Myronenko, Song: *Point Set Registration: Coherent Point Drift*, TPAMI 32 (2010), doi 10.1109/TPAMI.2010.46.
Symbols as there: X (N, 3) the cloud, Y (M, 3) the previous nodes, T = Y + G W the new nodes, P the posterior
probabilities, sigma² the common variance of all Gaussians, w the weight of the uniform outlier class, beta the
width of the kernel G. SPR adds a penalty to the M-step; all else is shared. Both steps are
compiled (`compiled`).
"""

# The papers' capital letters are variables here, not constants.
# pyright: reportConstantRedefinition=false

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from msgspec import Meta

from dlokit.ranges import Count, NotNegative, Positive, check_ranges
from dlokit.types.arrays import Float64Array

RANK_TOLERANCE = 1e-15
"""L has no further columns when the remainder of G's diagonal, which is 1, is below this: the rounding of G itself."""


OutlierWeight = Annotated[float, Meta(ge=0.0, lt=1.0)]


@dataclass(frozen=True, kw_only=True)
class MixtureConfig:
    """The fit of a mixture whose nodes move coherently."""

    beta_m: Positive = 0.83
    """Width of the Gaussian kernel [m]: nodes nearer than this move alike."""
    lambda_per_m2: Positive = 2300.0
    """Weight of the smoothness of the motion against the fit [1/m²]."""
    outlier_weight: OutlierWeight = 0.023
    """w, the expected fraction of outliers among the points, from 0 to below 1."""
    initial_sigma_m: NotNegative = 0.036
    """Standard deviation of the Gaussians at the start [m]; about the largest motion between two clouds.
    0: the paper's value, the mean distance of all pairs, for a registration from far."""
    smallest_sigma_m: NotNegative = 0.002
    """The iteration ends below this standard deviation [m]; about the noise of the cloud."""
    tolerance: NotNegative = 1e-3
    """The iteration ends when sigma² changes by a smaller fraction than this."""
    max_iterations: Count = 60
    """Most steps of an iteration."""
    max_points: Count = 2000
    """Most points of a cloud; larger clouds are thinned, evenly over their index, before registration."""

    def __post_init__(self) -> None:
        check_ranges(self, "observer.strategy")


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of an iteration against the fit."""

    lambda_per_m2: float
    """Weight of the smoothness of the motion [1/m²]."""
    tau_per_m2: float = 0.0
    """Weight of the local structure in SPR [1/m²]."""


@dataclass(frozen=True, kw_only=True)
class Registration:
    """The outcome of one fit."""

    nodes: Float64Array
    """T (M, 3) [m]."""
    coefficients: Float64Array
    """W (M, 3) [m]: the motion anywhere is v(z) = sum_m exp(-|z - y_m|² / (2 beta²)) w_m, eq. 18 ff."""
    sigma2: Float64Array
    """sigma² before the first and after each iteration (iterations + 1,) [m²]."""


class MixtureFit:
    """A fit of the nodes Y (M, 3) [m] to the cloud X (N, 3) [m], N >= 1, iteration by iteration.

    `weights` are those of an iteration, counted from 0; `structure` (M, M) is SPR's matrix of the local structure.
    """

    def __init__(
        self,
        X: Float64Array,
        Y: Float64Array,
        config: MixtureConfig,
        weights: Callable[[int], Weights],
        structure: Float64Array | None = None,
    ) -> None:
        from dlokit.skills.observer.compiled import sorted_blocks

        self._config, self._weights = config, weights
        self._origin = Y.mean(axis=0)  # squared distances from products lose digits far from the origin
        X, Y = X - self._origin, Y - self._origin
        self._motions = CoherentMotion(Y, kernel(Y, config.beta_m), structure)
        self._columns, self._boxes = sorted_blocks(X, longest_axis(Y))
        self._T = Y
        self._last = (np.zeros(len(Y)), np.zeros_like(Y), Y, 1.0, 0.0)  # arguments of `coefficients`; W is 0 at first
        self._sigma2 = [initial_sigma2(X, Y) if config.initial_sigma_m == 0 else config.initial_sigma_m**2]

    def iterate(self) -> bool:
        """Do one E-step and one M-step of Fig. 4; return whether to continue.

        sigma² = (tr Xᵀ d(Pᵀ1) X - 2 tr (PX)ᵀ T + tr Tᵀ d(P1) T) / (N_P D), eq. 23.
        """
        from dlokit.skills.observer.compiled import expectation

        config, before = self._config, self._sigma2[-1]
        P1, PX, squares = expectation(self._columns, self._boxes, self._T, before, config.outlier_weight)
        weights = self._weights(len(self._sigma2) - 1)
        ridge, stiffness = weights.lambda_per_m2 * before, weights.tau_per_m2 * before
        T = self._motions.nodes(P1, PX, ridge, stiffness)
        self._T, self._last = T, (P1, PX, T, ridge, stiffness)
        misfit = squares - 2.0 * np.vdot(PX, T) + P1 @ np.einsum("md,md->m", T, T)
        explained = max(float(P1.sum()), np.finfo(np.float64).tiny)
        after = max(float(misfit) / (explained * T.shape[1]), config.smallest_sigma_m**2 / 4)
        self._sigma2.append(after)
        settled = abs(before - after) < config.tolerance * before
        return not settled and after >= config.smallest_sigma_m**2

    def result(self) -> Registration:
        """The result of the iterations so far."""
        W = self._motions.coefficients(*self._last)
        return Registration(nodes=self._T + self._origin, coefficients=W, sigma2=np.array(self._sigma2))


def fit_mixture(
    X: Float64Array,
    Y: Float64Array,
    config: MixtureConfig,
    weights: Callable[[int], Weights],
    structure: Float64Array | None = None,
) -> Registration:
    """Move the nodes Y (M, 3) [m] onto the cloud X (N, 3) [m], N >= 1; the loop of Fig. 4.

    Arguments as those of `MixtureFit`.
    """
    fit = MixtureFit(X, Y, config, weights, structure)
    for _ in range(config.max_iterations):
        if not fit.iterate():
            break
    return fit.result()


class CoherentMotion:
    """The M-step of CPD and SPR: nodes that move coherently, solved with as many unknowns as the kernel's rank.

    Symbols as in the module and in `spr`. Both solve, for T = Y + G W,

        (d(P1) G + lambda sigma² I + tau sigma² M G) W = P X - d(P1) Y - tau sigma² M Y,

    CPD with tau = 0 (eq. 22 times d(P1), so that nodes without points need no division). The Gaussian kernel's
    eigenvalues fall so fast that G = L Lᵀ to the last digit with r < M columns. Multiplied by Lᵀ from the left, with
    c = Lᵀ W:

        (lambda sigma² I + Lᵀ (d(P1) + tau sigma² M) L) c = Lᵀ (P X - d(P1) Y - tau sigma² M Y),   T = Y + L c:

    r unknowns in place of M.

    The arguments are the nodes Y (M, 3) [m], the kernel G (M, M) and SPR's structure matrix (M, M).
    """

    def __init__(self, Y: Float64Array, G: Float64Array, structure: Float64Array | None = None) -> None:
        M = len(Y)
        self._Y = Y
        self._structure = np.zeros((M, M)) if structure is None else structure
        self._L = low_rank(G)
        self._stiff = self._L.T @ self._structure @ self._L
        self._strained = self._L.T @ self._structure @ Y

    def nodes(self, P1: Float64Array, PX: Float64Array, ridge: float, stiffness: float = 0.0) -> Float64Array:
        """T (M, 3) [m] from P 1 (M,) and P X (M, 3) [m]; `ridge` is lambda sigma² > 0, `stiffness` tau sigma².

        Raises `numpy.linalg.LinAlgError` when the ridge is too small for the system to have one solution.
        """
        from dlokit.skills.observer.compiled import coherent_nodes

        if not ridge > 0.0:
            raise np.linalg.LinAlgError(f"lambda sigma² = {ridge:g} is too small for a solution; it must be above 0.")
        return coherent_nodes(self._Y, self._L, self._stiff, self._strained, P1, PX, ridge, stiffness)

    def coefficients(
        self, P1: Float64Array, PX: Float64Array, T: Float64Array, ridge: float, stiffness: float = 0.0
    ) -> Float64Array:
        """W (M, 3) of the step that gave T, by the same equation: lambda sigma² W = P X - d(P1) T - tau sigma² M T."""
        return (PX - P1[:, None] * T - stiffness * (self._structure @ T)) / ridge


def low_rank(G: Float64Array) -> Float64Array:
    """L (M, r) with L Lᵀ = G (M, M) to `RANK_TOLERANCE`: Cholesky's method with the largest pivot first."""
    (pstrf,) = scipy.linalg.get_lapack_funcs(("pstrf",), (G,))
    factor, pivots, rank, _ = pstrf(G, tol=RANK_TOLERANCE, lower=True)
    L = np.zeros((len(G), rank))
    L[pivots - 1] = np.tril(factor)[:, :rank]  # LAPACK counts from 1
    return L


def longest_axis(Y: Float64Array) -> Float64Array:
    """The direction (3,) in which the nodes (M, 3) about their centre extend most."""
    return np.linalg.eigh(Y.T @ Y)[1][:, -1]


def kernel(Y: Float64Array, beta_m: float) -> Float64Array:
    """G (M, M) with g_ij = exp(-|y_i - y_j|² / (2 beta²)), eq. 16 ff."""
    return np.exp(squared_distances(Y, Y) / (-2.0 * beta_m**2))


def initial_sigma2(X: Float64Array, Y: Float64Array) -> float:
    """The mean over all pairs of |x_n - y_m|² / D [m²], X (N, D) and Y (M, D) [m], the initialisation of Fig. 4."""
    spread = np.mean(np.sum(X**2, axis=1)) + np.mean(np.sum(Y**2, axis=1)) - 2.0 * X.mean(axis=0) @ Y.mean(axis=0)
    return float(spread) / X.shape[1]


def motion(places: Float64Array, Y: Float64Array, result: Registration, beta_m: float) -> Float64Array:
    """Displacement (K, D) [m] of other places (K, D) [m] by the registration of the nodes Y."""
    return np.exp(squared_distances(places - Y.mean(axis=0), Y - Y.mean(axis=0)) / (-2.0 * beta_m**2)) @ (
        result.coefficients
    )


def thinned(points: Float64Array, count: int) -> Float64Array:
    """At most `count` of the points (N, D), spread evenly over their index."""
    if len(points) <= count:
        return points
    return points[np.linspace(0, len(points) - 1, count).astype(np.int64)]


def squared_distances(A: Float64Array, B: Float64Array) -> Float64Array:
    """|a_i - b_j|² (len(A), len(B)), from the products of the points."""
    squared = A @ B.T
    squared *= -2.0
    squared += np.sum(A**2, axis=1)[:, None]
    squared += np.sum(B**2, axis=1)
    return np.maximum(squared, 0.0, out=squared)
