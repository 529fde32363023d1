"""The coarse stage of the MAP observer: from the nodes before to the basin of the right answer."""

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map_align import moved_rigidly
from dlokit.skills.observer.map_assign import soft_places
from dlokit.skills.observer.map_frame import Frame, with_priors
from dlokit.skills.observer.map_settings import MapSettings
from dlokit.skills.observer.map_terms import add_places
from dlokit.skills.observer.mixture import thinned

Array = NDArray[np.float64]


def coarse(frame: Frame, config: MapSettings) -> tuple[Array, Array]:
    """Nodes near the cloud, and the nodes before moved rigidly to them; both (M, 3) [m].

    Points belong to nodes softly, with a Gaussian that narrows from the way since the last cloud to about a
    node spacing. Rest lengths stiffen with it: a chain that could not stretch at all would not get round bends.
    """
    points = thinned(frame.points, config.coarse_points)
    nodes, before = frame.before, frame.before
    share = min(len(nodes) / len(points) * config.most_points, 1.0)
    sigma = max(frame.way_m, config.narrowest_m)
    while True:
        weights, sums = soft_places(points, nodes, sigma, config.outlier_ratio)
        drawn = (sums + 1e-6 * nodes) / (weights + 1e-6)[:, None]  # a node without points stays
        before = moved_rigidly(frame.before, drawn, weights + 1e-6)
        system = with_priors(frame, nodes, before, frame.way_m, max(config.priors.length_m, sigma / 16), config)
        scale = share / sigma**2
        add_places(system, weights * scale, sums * scale)
        nodes = system.solve()
        if sigma <= config.narrowest_m:
            return nodes, before
        sigma = max(sigma * config.narrowing, config.narrowest_m)
