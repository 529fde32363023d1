"""The coarse stage: moves the previous nodes rigidly, then to the basin of the right solution."""

import numpy as np
from numba import njit

from dlokit.skills.observer.map.assign import MOST_POINTS, soft_places
from dlokit.skills.observer.map.problem import COARSE_POINTS, LENGTH_SIGMA_M, MapProblem, with_priors
from dlokit.skills.observer.map.terms import add_places
from dlokit.skills.observer.mixture import thinned
from dlokit.types.arrays import Float64Array

_NARROWEST_M = 0.008
"""Width of the soft assignment at its end [m]; about a node spacing."""
_NARROWING = 0.75
"""Factor on the width from one coarse step to the next."""
_OUTLIER_RATIO = 0.1
"""Density of outliers, as a fraction of the peak of a node's Gaussian."""


@njit(cache=True)
def moved_rigidly(before: Float64Array, after: Float64Array, weights: Float64Array) -> Float64Array:
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


def coarse(problem: MapProblem) -> tuple[Float64Array, Float64Array]:
    """Nodes near the cloud, and the nodes before moved rigidly to them; both (M, 3) [m].

    Points belong to nodes softly, with a Gaussian that narrows from the distance travelled since the last cloud to a
    node spacing. Rest lengths stiffen with it: a chain that could not stretch at all would not get round bends.
    """
    points = thinned(problem.points, COARSE_POINTS)
    nodes, before = problem.before, problem.before
    share = min(len(nodes) / len(points) * MOST_POINTS, 1.0)
    sigma = max(problem.way_m, _NARROWEST_M)
    while True:
        weights, sums = soft_places(points, nodes, sigma, _OUTLIER_RATIO)
        drawn = (sums + 1e-6 * nodes) / (weights + 1e-6)[:, None]  # a node without points stays
        before = moved_rigidly(problem.before, drawn, weights + 1e-6)
        system = with_priors(problem, nodes, before, problem.way_m, max(LENGTH_SIGMA_M, sigma / 16))
        add_places(system.band, system.rhs, weights, sums, share / sigma**2)
        nodes = system.solve()
        if sigma <= _NARROWEST_M:
            return nodes, before
        sigma = max(sigma * _NARROWING, _NARROWEST_M)
