"""How sure the MAP observer is: a covariance for each node and a health for all."""

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map.fine import Fitted, add_cloud, add_tips
from dlokit.skills.observer.map.problem import Problem, with_priors
from dlokit.skills.observer.map.settings import MapSettings

Array = NDArray[np.float64]


def stated_covariance(problem: Problem, before: Array, fitted: Fitted, config: MapSettings) -> Array:
    """Covariance of each node (M, 3, 3) [m²].

    Of a node's variances, traces of blocks of H⁻¹: `fresh`, were the shape before exactly right; `alone`, did it say
    nothing. Its own is min(fresh + remembered x before, alone): it grows from cloud to cloud while the node is
    hidden, up to what lengths and bending allow, and is what the cloud says once the cloud shows it. What
    fits nowhere (`astray_m`) is added to all.
    """
    trust = config.trust
    fresh = _shape_covariance(problem, before, fitted, problem.way_m, config)
    alone = _shape_covariance(problem, before, fitted, trust.forgotten_m, config)
    variance, most = _traces(fresh), _traces(alone)
    own = np.minimum(variance + trust.remembered * problem.variance_before, most)
    share = np.where(own < most, own / variance, 1.0)
    blocks = np.where((own < most)[:, None, None], fresh, alone) * share[:, None, None]
    return blocks + np.eye(3) * (astray_m(problem, fitted, config) ** 2 / 3.0)


def _shape_covariance(problem: Problem, before: Array, fitted: Fitted, way_m: float, config: MapSettings) -> Array:
    """The diagonal blocks of H⁻¹ (M, 3, 3) [m²] for a rod that went `way_m`, with the errors that points share.

    The H that finds the nodes would be overconfident: neighbouring points err alike.
    """
    system = with_priors(problem, fitted.nodes, before, way_m, config.priors.length_m, config)
    few = config.trust.independent_points
    add_cloud(system, problem.points, fitted.nodes, fitted.placed, config.noise_m, few, config)
    add_tips(system, fitted.nodes, fitted.tips, config.priors.tip_m)
    return system.covariance()


def _traces(blocks: Array) -> Array:
    """Variance in all directions together (M,) of blocks (M, 3, 3)."""
    return np.trace(blocks, axis1=1, axis2=2)


def astray_m(problem: Problem, fitted: Fitted, config: MapSettings) -> float:
    """How much of the rod fits nowhere [m]: a rod that lies where it is said to be has its length where it is seen.

    The length of the nodes in open view without points, and half of what the way from tip to tip over the cloud
    differs from the rod's length: the nodes between slid by as much.
    """
    length_m = float(problem.rod_m[-1])
    first, last = fitted.tips.first_m, fitted.tips.last_m
    misfit_m = 0.0 if first is None or last is None else 0.5 * abs(last - first - length_m)
    return float(np.hypot(missing(problem, fitted, config) * length_m, misfit_m))


def health(problem: Problem, fitted: Fitted, covariance: Array, config: MapSettings) -> float:
    """Trust in the whole, 0 to 1: a product of four shares.

    Points that lie within 5 standard deviations of the rod, by the share that is usual; 1 / (1 + rms² / half²) with the
    root mean square of the nodes' standard deviations; 1 less `trust.missing` times the share of missing nodes; and
    `trust.tip` for each tip that is neither seen nor held nor known to be hidden.
    """
    trust = config.trust
    mean_square = float(np.mean(_traces(covariance)))
    sure = 1.0 / (1.0 + mean_square / trust.half_m**2)
    present = max(1.0 - trust.missing * missing(problem, fitted, config), 0.0)
    usual = min(explained(fitted, config) / trust.usual_share, 1.0)
    held = {node for node, _ in problem.pins}
    ends = ((fitted.tips.first_m, 0), (fitted.tips.last_m, len(fitted.nodes) - 1))
    unseen = sum(known is None and node not in held and not fitted.shaded[node] for known, node in ends)
    return float(np.clip(usual * sure * present * trust.tip**unseen, 0.0, 1.0))


def explained(fitted: Fitted, config: MapSettings) -> float:
    """Share of the points that lie within 5 standard deviations of the rod."""
    return float(np.mean(fitted.placed.distance2 < (5.0 * config.noise_m) ** 2))


def missing(problem: Problem, fitted: Fitted, config: MapSettings) -> float:
    """Share of the nodes that should have points and have none; less where nothing tells what hides them."""
    tells = problem.view is not None and problem.view.tells
    return float(np.mean(~fitted.supported & ~fitted.shaded)) * (1.0 if tells else config.trust.unknown)
