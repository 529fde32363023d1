"""The problem that one cloud poses, and what does not depend on which point belongs where."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.skills.observer.map_settings import MapSettings
from dlokit.skills.observer.map_solver import ChainSystem
from dlokit.skills.observer.map_terms import add_coherence, add_lengths, add_place, add_table
from dlokit.skills.observer.mixture import squared_distances, thinned
from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One cloud and what was known before; positions about `origin`."""

    seen: Observation
    origin: Array
    """(3,) [m] in the world."""
    points: Array
    """(N, 3) [m], thinned."""
    before: Array
    """The nodes before (M, 3) [m]."""
    hidden_before: float
    """Share of the nodes that the last cloud did not show."""
    rod_m: Array
    """Arc length of the nodes on the rod (M,) [m]."""
    way_m: float
    """How far the rod is from where it was [m]: `way_since`, or what its grippers went."""
    pins: tuple[tuple[int, Array], ...]
    """Held nodes and where (3,) [m]."""
    floor_m: float
    """Lowest z of a node [m]."""


def framed(seen: Observation, prior: DloState, config: MapSettings) -> Frame:
    """The problem of one cloud with at least one point."""
    origin = prior.nodes_world.mean(axis=0)
    before = prior.nodes_world - origin
    pins = tuple((pin.node, np.asarray(pin.position_world, dtype=np.float64) - origin) for pin in seen.pins)
    carried = max((float(np.linalg.norm(place - before[node])) for node, place in pins), default=0.0)
    points = thinned(np.asarray(seen.points_world, dtype=np.float64), config.fine_points) - origin
    return Frame(
        seen=seen,
        origin=origin,
        points=points,
        before=before,
        hidden_before=0.0 if prior.visible is None else 1.0 - float(np.mean(prior.visible)),
        rod_m=np.concatenate(([0.0], np.cumsum(prior.topology.rest_lengths_m))),
        way_m=max(way_since(thinned(points, config.coarse_points), before, config), min(carried, config.widest_m)),
        pins=pins,
        floor_m=config.table_z_m + config.radius_m - float(origin[2]),
    )


def way_since(points: Array, before: Array, config: MapSettings) -> float:
    """How far the rod went: 1.5 times the distance of four points in five to the nodes before, within limits [m].

    Points (n, 3) see only the way across the rod, hence the 1.5.
    """
    nearest = np.sqrt(np.min(squared_distances(points, before), axis=1))
    return float(np.clip(1.5 * np.quantile(nearest, 0.8), config.least_way_m, config.widest_m))


def with_priors(
    frame: Frame, nodes: Array, before: Array, way_m: float, length_sigma_m: float, config: MapSettings
) -> ChainSystem:
    """Normal equations at `nodes` with all that does not come from the cloud; `before` moved rigidly."""
    system = ChainSystem(len(nodes))
    rest = np.diff(frame.rod_m)
    add_coherence(system, before, float(np.mean(rest)), way_m, config.priors)
    add_lengths(system, nodes, rest, length_sigma_m)
    add_table(system, nodes, frame.floor_m, config.priors.table_m)
    for node, place in frame.pins:
        add_place(system, node, place, config.priors.pin_m)
    return system
