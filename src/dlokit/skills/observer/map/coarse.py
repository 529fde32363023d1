"""The coarse stage: from the nodes before to the basin of the right answer."""

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map.align import moved_rigidly
from dlokit.skills.observer.map.assign import soft_places
from dlokit.skills.observer.map.problem import Problem, with_priors
from dlokit.skills.observer.map.settings import MapSettings
from dlokit.skills.observer.map.terms import add_places
from dlokit.skills.observer.mixture import thinned

Array = NDArray[np.float64]


def coarse(problem: Problem, config: MapSettings) -> tuple[Array, Array]:
    """Nodes near the cloud, and the nodes before moved rigidly to them; both (M, 3) [m].

    Points belong to nodes softly, with a Gaussian that narrows from the way since the last cloud to about a
    node spacing. Rest lengths stiffen with it: a chain that could not stretch at all would not get round bends.
    """
    points = thinned(problem.points, config.coarse_points)
    nodes, before = problem.before, problem.before
    share = min(len(nodes) / len(points) * config.most_points, 1.0)
    sigma = max(problem.way_m, config.narrowest_m)
    while True:
        weights, sums = soft_places(points, nodes, sigma, config.outlier_ratio)
        drawn = (sums + 1e-6 * nodes) / (weights + 1e-6)[:, None]  # a node without points stays
        before = moved_rigidly(problem.before, drawn, weights + 1e-6)
        system = with_priors(problem, nodes, before, problem.way_m, max(config.priors.length_m, sigma / 16), config)
        add_places(system.band, system.rhs, weights, sums, share / sigma**2)
        nodes = system.solve()
        if sigma <= config.narrowest_m:
            return nodes, before
        sigma = max(sigma * config.narrowing, config.narrowest_m)
