"""How sure the MAP observer is: a covariance for each node and a health for all."""

import numpy as np
from numba import njit

from dlokit.skills.observer.map.fine import Fitted, add_cloud, add_tips
from dlokit.skills.observer.map.problem import MapProblem, with_priors
from dlokit.skills.observer.map.settings import MapSettings
from dlokit.skills.observer.map.terms import add_coherence
from dlokit.types.arrays import Float64Array


def stated_covariance(problem: MapProblem, before: Float64Array, fitted: Fitted, config: MapSettings) -> Float64Array:
    """Covariance of each node (M, 3, 3) [m²].

    A node's own is `carried`, of H⁻¹ with the shape before and without; what fits nowhere (`astray_m`) is added to all.
    """
    fresh, alone = _shape_covariances(problem, before, fitted, config)
    astray2 = astray_m(problem, fitted, config) ** 2
    return carried(fresh, alone, problem.variance_before, config.trust.remembered, astray2)


@njit(cache=True)
def carried(
    fresh: Float64Array, alone: Float64Array, before: Float64Array, remembered: float, common: float
) -> Float64Array:
    """Covariance of each node (M, 3, 3) [m²], given its variance `before` (M,) [m²], all directions together.

    `fresh` (M, 3, 3) would be right were the shape before exactly right, `alone` did it say nothing. With traces, a
    variance is min(fresh + remembered x before, alone): it grows from cloud to cloud while the node is hidden, up
    to what lengths and bending allow, and is what the cloud says once the cloud shows it. `common` [m²] is added.
    """
    blocks = alone.copy()
    for node in range(before.shape[0]):
        new = fresh[node, 0, 0] + fresh[node, 1, 1] + fresh[node, 2, 2]
        most = alone[node, 0, 0] + alone[node, 1, 1] + alone[node, 2, 2]
        own = new + remembered * before[node]
        if own < most:
            blocks[node] = fresh[node] * (own / new)
        for axis in range(3):
            blocks[node, axis, axis] += common / 3.0
    return blocks


def _shape_covariances(
    problem: MapProblem, before: Float64Array, fitted: Fitted, config: MapSettings
) -> tuple[Float64Array, Float64Array]:
    """The diagonal blocks of H⁻¹ (M, 3, 3) [m²], for a rod that keeps its shape as usual, and for one that does not.

    The H that finds the nodes would be overconfident: neighbouring points err alike.
    """
    trust, priors = config.trust, config.priors
    system = with_priors(problem, fitted.nodes, before, trust.forgotten_m, priors.length_m, config)
    few = trust.independent_points
    add_cloud(system, problem.points, fitted.nodes, fitted.placed, config.noise_m, few, config)
    add_tips(system, fitted.nodes, fitted.tips, priors.tip_m)
    alone = system.covariance()
    kept = problem.K_d * (1.0 / problem.way_m**2 - 1.0 / trust.forgotten_m**2)
    add_coherence(system.band, system.rhs, before, kept, np.zeros_like(kept))
    return system.covariance(), alone


def astray_m(problem: MapProblem, fitted: Fitted, config: MapSettings) -> float:
    """How much of the rod fits nowhere [m]: a rod that lies where it is said to be has its length where it is seen.

    The length of the nodes in open view without points, where the picture tells that nothing hides them, and half
    of what the way from tip to tip over the cloud differs from the rod's length: the nodes between slid by as much.
    At most `half_m`, for what is missing may also be hidden by something that nobody knows.
    """
    length_m = float(problem.rod_m[-1])
    first, last = fitted.tips.first_m, fitted.tips.last_m
    misfit_m = 0.0 if first is None or last is None else 0.5 * abs(last - first - length_m)
    gone_m = missing(problem, fitted, config) * length_m if _tells(problem) else 0.0
    return min(float(np.hypot(gone_m, misfit_m)), config.trust.half_m)


def health(problem: MapProblem, fitted: Fitted, covariance: Float64Array, config: MapSettings) -> float:
    """Trust in the whole, 0 to 1: a product of four shares. `covariance` (M, 3, 3) [m²].

    Points that lie within 5 standard deviations of the rod, by the share that is usual; 1 / (1 + rms² / half²) with the
    root mean square of the nodes' standard deviations; 1 less the share of missing nodes, times `trust.missing` but not
    below `trust.present_least` where the picture tells that nothing hides them; and `trust.tip` for each tip that is
    neither seen nor held nor known to be hidden.
    """
    trust = config.trust
    mean_square = float(np.einsum("nii->", covariance)) / len(covariance)
    sure = 1.0 / (1.0 + mean_square / trust.half_m**2)
    gone = missing(problem, fitted, config)
    present = max(1.0 - trust.missing * gone, trust.present_least) if _tells(problem) else 1.0 - gone
    usual = min(explained(fitted, config) / trust.usual_share, 1.0)
    held = {node for node, _ in problem.pins}
    ends = ((fitted.tips.first_m, 0), (fitted.tips.last_m, len(fitted.nodes) - 1))
    unseen = sum(known is None and node not in held and not fitted.shaded[node] for known, node in ends)
    return float(np.clip(usual * sure * present * trust.tip**unseen, 0.0, 1.0))


def explained(fitted: Fitted, config: MapSettings) -> float:
    """Share of the points that lie within 5 standard deviations of the rod."""
    return float(np.mean(fitted.placed.distance2 < (5.0 * config.noise_m) ** 2))


def missing(problem: MapProblem, fitted: Fitted, config: MapSettings) -> float:
    """Share of the nodes that should have points and have none; less where nothing tells what hides them."""
    return float(np.mean(~fitted.supported & ~fitted.shaded)) * (1.0 if _tells(problem) else config.trust.unknown)


def _tells(problem: MapProblem) -> bool:
    """Whether it is known what hides the rod."""
    return problem.view is not None and problem.view.tells
