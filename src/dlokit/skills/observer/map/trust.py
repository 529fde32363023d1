"""Uncertainty of the MAP observer: a covariance for each node and one health."""

import numpy as np
from numba import njit

from dlokit.skills.observer.map.problem import LENGTH_SIGMA_M, MapProblem, with_priors
from dlokit.skills.observer.map.stages import Fitted, add_cloud, add_tips
from dlokit.skills.observer.map.terms import add_coherence
from dlokit.types.arrays import Float64Array

# Set on sequences with known truth.
_INDEPENDENT_POINTS = 1.0
"""The points of a segment count as this many independent ones, because the model's error is common to them."""
_REMEMBERED = 0.9
"""Fraction of a node's previous variance that remains while the cloud does not show the node."""
_FORGOTTEN_M = 0.5
"""A rod that moved this far may have any shape [m]; the variance from the cloud alone assumes this motion."""
_UNKNOWN = 0.4
"""Weight of a node without points among the missing nodes when the occlusion is unknown."""
_USUAL_FRACTION = 0.85
"""Health does not decrease while at least this fraction of the points is on the rod; the rest are outliers."""
_MISSING = 5.0
"""Factor on the fraction of missing nodes in health, where the picture shows that nothing hides them."""
_PRESENT_LEAST = 0.6
"""Lowest factor on health for missing nodes alone: an unknown object may hide them."""
_TIP = 0.88
"""Factor on health for each tip that should be visible and is not."""
_HALF_M = 0.05
"""Root mean square of the stated standard deviations at which health is halved [m]."""


def stated_covariance(problem: MapProblem, before: Float64Array, fitted: Fitted) -> Float64Array:
    """Covariance of each node (M, 3, 3) [m²].

    A node's own part is `carried`, from H⁻¹ with and without the previous shape; `unexplained_m` is added to all nodes.
    """
    given_shape, alone = _shape_covariances(problem, before, fitted)
    unexplained2 = unexplained_m(problem, fitted) ** 2
    return carried(given_shape, alone, problem.variance_before, _REMEMBERED, unexplained2)


@njit(cache=True)
def carried(
    given_shape: Float64Array, alone: Float64Array, before: Float64Array, remembered: float, common: float
) -> Float64Array:
    """Covariance of each node (M, 3, 3) [m²], given its previous total variance `before` (M,) [m²].

    `given_shape` (M, 3, 3) holds if the previous shape is exactly right, `alone` if it is unknown. In traces, a
    variance is min(given_shape + remembered x before, alone): it grows from cloud to cloud while the node is hidden, up
    to the limit from lengths and bending, and equals the cloud's variance once the cloud shows the node. `common` [m²]
    is added.
    """
    blocks = alone.copy()
    for node in range(before.shape[0]):
        new = given_shape[node, 0, 0] + given_shape[node, 1, 1] + given_shape[node, 2, 2]
        most = alone[node, 0, 0] + alone[node, 1, 1] + alone[node, 2, 2]
        own = new + remembered * before[node]
        if own < most:
            blocks[node] = given_shape[node] * (own / new)
        for axis in range(3):
            blocks[node, axis, axis] += common / 3.0
    return blocks


def _shape_covariances(problem: MapProblem, before: Float64Array, fitted: Fitted) -> tuple[Float64Array, Float64Array]:
    """The diagonal blocks of H⁻¹ (M, 3, 3) [m²], for a rod that keeps its shape, and for one that may have any shape.

    The H that finds the nodes would be overconfident: neighbouring points err alike.
    """
    system = with_priors(problem, fitted.nodes, before, _FORGOTTEN_M, LENGTH_SIGMA_M)
    add_cloud(system, problem.points, fitted.nodes, fitted.placed, problem.noise_m, _INDEPENDENT_POINTS)
    add_tips(system, fitted.nodes, fitted.tips)
    alone = system.covariance()
    kept = problem.K_d * (1.0 / problem.moved_m**2 - 1.0 / _FORGOTTEN_M**2)
    add_coherence(system.band, system.rhs, before, kept, np.zeros_like(kept))
    return system.covariance(), alone


def unexplained_m(problem: MapProblem, fitted: Fitted) -> float:
    """Length of the rod that the cloud does not explain [m], at most `_HALF_M`: an unknown object may hide points.

    It combines the length of the nodes in open view without points, where the picture shows that nothing hides them,
    with half the difference between the arc length from tip to tip over the cloud and the rod's length: the nodes
    between the tips slid by that distance.
    """
    length_m = float(problem.rod_m[-1])
    first, last = fitted.tips.first_m, fitted.tips.last_m
    misfit_m = 0.0 if first is None or last is None else 0.5 * abs(last - first - length_m)
    gone_m = missing(problem, fitted) * length_m if _occlusion_known(problem) else 0.0
    return min(float(np.hypot(gone_m, misfit_m)), _HALF_M)


def health(problem: MapProblem, fitted: Fitted, covariance: Float64Array) -> float:
    """Health, 0 to 1: a product of four factors. `covariance` (M, 3, 3) [m²].

    Fraction of points within 5 standard deviations of the rod, relative to the usual fraction; 1 / (1 + rms² / half²)
    with the root mean square of the nodes' standard deviations; 1 less the fraction of missing nodes, times `_MISSING`
    but not below `_PRESENT_LEAST` where the picture shows that nothing hides them; and `_TIP` for each tip that is
    not seen, not held and not known to be hidden.
    """
    mean_square = float(np.einsum("nii->", covariance)) / len(covariance)
    certain = 1.0 / (1.0 + mean_square / _HALF_M**2)
    gone = missing(problem, fitted)
    present = max(1.0 - _MISSING * gone, _PRESENT_LEAST) if _occlusion_known(problem) else 1.0 - gone
    usual = min(explained(problem, fitted) / _USUAL_FRACTION, 1.0)
    held = {node for node, _ in problem.pins}
    ends = ((fitted.tips.first_m, 0), (fitted.tips.last_m, len(fitted.nodes) - 1))
    unseen = sum(known is None and node not in held and not fitted.shaded[node] for known, node in ends)
    return float(np.clip(usual * certain * present * _TIP**unseen, 0.0, 1.0))


def explained(problem: MapProblem, fitted: Fitted) -> float:
    """Fraction of the points within 5 standard deviations of the rod."""
    return float(np.mean(fitted.placed.distance2 < (5.0 * problem.noise_m) ** 2))


def missing(problem: MapProblem, fitted: Fitted) -> float:
    """Fraction of the nodes that should have points and have none; weighted down where the occlusion is unknown."""
    return float(np.mean(~fitted.supported & ~fitted.shaded)) * (1.0 if _occlusion_known(problem) else _UNKNOWN)


def _occlusion_known(problem: MapProblem) -> bool:
    """Whether the occlusion of the rod is known."""
    return problem.view is not None and problem.view.occlusion_known
