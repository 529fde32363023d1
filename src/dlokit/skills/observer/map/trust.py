"""How sure the MAP observer is: a covariance for each node and a health for all."""

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map.fine import Fitted, add_cloud, add_tips
from dlokit.skills.observer.map.problem import Problem, with_priors
from dlokit.skills.observer.map.settings import MapSettings

Array = NDArray[np.float64]


def stated_covariance(problem: Problem, before: Array, fitted: Fitted, config: MapSettings) -> Array:
    """Covariance of each node (M, 3, 3) [m²]: the diagonal blocks of H⁻¹, H with the errors that points share.

    The H that finds the nodes would be overconfident: neighbouring points err alike, and what a hidden stretch
    does between two clouds adds up while it is hidden.
    """
    trust = config.trust
    way_m = problem.way_m * trust.drift * (1.0 + trust.hidden_before * problem.hidden_before)
    system = with_priors(problem, fitted.nodes, before, way_m, config.priors.length_m, config)
    add_cloud(system, problem.points, fitted.nodes, fitted.placed, config.noise_m, trust.independent_points, config)
    add_tips(system, fitted.nodes, fitted.tips, float(np.hypot(trust.tip_m, _span_misfit_m(problem, fitted))))
    return system.covariance() * trust.factor**2


def _span_misfit_m(problem: Problem, fitted: Fitted) -> float:
    """By how much the way from tip to tip over the cloud differs from the rod's length, half of it at each tip [m]."""
    first, last = fitted.tips.first_m, fitted.tips.last_m
    if first is None or last is None:
        return 0.0
    return 0.5 * abs(last - first - float(problem.rod_m[-1]))


def health(problem: Problem, fitted: Fitted, covariance: Array, config: MapSettings) -> float:
    """Trust in the whole, 0 to 1: a product of four shares.

    Points that lie within 5 standard deviations of the rod; 1 / (1 + rms² / half²) with the root mean square of the
    nodes' standard deviations; nodes with points, where one without them counts in full only if the picture
    tells that nothing hides it; and `trust.tip` for each tip that is neither seen nor held nor known to be hidden.
    """
    trust = config.trust
    mean_square = float(np.mean(np.trace(covariance, axis1=1, axis2=2)))
    sure = 1.0 / (1.0 + mean_square / trust.half_m**2)
    present = 1.0 - missing(problem, fitted, config)
    held = {node for node, _ in problem.pins}
    ends = ((fitted.tips.first_m, 0), (fitted.tips.last_m, len(fitted.nodes) - 1))
    unseen = sum(known is None and node not in held and not fitted.shaded[node] for known, node in ends)
    return float(np.clip(explained(fitted, config) * sure * present * trust.tip**unseen, 0.0, 1.0))


def explained(fitted: Fitted, config: MapSettings) -> float:
    """Share of the points that lie within 5 standard deviations of the rod."""
    return float(np.mean(fitted.placed.distance2 < (5.0 * config.noise_m) ** 2))


def missing(problem: Problem, fitted: Fitted, config: MapSettings) -> float:
    """Share of the nodes that should have points and have none; less where nothing tells what hides them."""
    tells = problem.view is not None and problem.view.tells
    return float(np.mean(~fitted.supported & ~fitted.shaded)) * (1.0 if tells else config.trust.unknown)
