"""The most probable nodes given the cloud and what a rod is: an iterated Gauss-Newton MAP with a banded solve.

Two stages a cloud, each with x from H x = b of `map_terms` at every step. Coarse: points belong to nodes softly,
with a Gaussian that narrows from the largest motion to a node spacing (`map_assign.soft_places`). Then nodes
take the places along the rod that the seen tips give them (`map_tips`). Fine: points to segments, within a window
of arc length, outliers weighed down. The last H also gives each node's covariance, H⁻¹'s diagonal blocks.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dlokit.geometry import arc_lengths
from dlokit.skills.observer.anchored import is_chain
from dlokit.skills.observer.base import nothing_seen
from dlokit.skills.observer.cpd import CpdConfig, register
from dlokit.skills.observer.curve import polyline_at
from dlokit.skills.observer.map_align import moved_rigidly
from dlokit.skills.observer.map_assign import Assignment, assign, inlier_probability, nearest_segment, soft_places
from dlokit.skills.observer.map_solver import ChainSystem
from dlokit.skills.observer.map_terms import (
    ChainPriors,
    add_along,
    add_coherence,
    add_lengths,
    add_place,
    add_places,
    add_points,
    add_table,
    coherence,
)
from dlokit.skills.observer.map_tips import TipConfig, Tips, extent, places_along, seen_tips
from dlokit.skills.observer.mixture import squared_distances, thinned
from dlokit.skills.observer.partial import register_visible
from dlokit.skills.observer.visibility import VisibilityConfig, shaded
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """The most probable rod: stiff lengths, coherent motion, seen tips; says how sure it is of each node."""

    name: ClassVar[str] = "map"

    priors: ChainPriors = field(default_factory=ChainPriors)
    """What a rod is held to, besides the cloud."""
    tips: TipConfig = field(default_factory=TipConfig)
    """When the end of a cloud is a tip."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """When a node counts as seen."""
    widest_m: float = 0.05
    """Width of the soft assignment at the start, at most [m]; about the largest motion between two clouds."""
    narrowest_m: float = 0.008
    """Width of the soft assignment at its end [m]; about a node spacing."""
    narrowing: float = 0.6
    """Factor on the width from one coarse step to the next."""
    coarse_points: int = 300
    """The coarse steps take at most so many points of the cloud."""
    fine_points: int = 1000
    """The fine steps take at most so many points of the cloud."""
    fine_steps: int = 4
    """Steps with points assigned to segments."""
    noise_m: float = 0.002
    """Standard deviation of the cloud's points from the rod [m]."""
    outlier_limit: float = 3.5
    """Beyond so many standard deviations a point is rather an outlier."""
    outlier_ratio: float = 0.1
    """Density of outliers in the coarse steps, as a share of the peak of a node's Gaussian."""
    most_points: float = 10.0
    """More points than this on a segment say no more than so many: their errors are not independent."""
    window_m: float = 0.05
    """A point's place along the rod changes by at most this during the fine steps [m]."""
    free_space_m: float = 0.02
    """Pull of a node that lies in open view without points towards the nearest point, as a standard deviation [m]."""
    radius_m: float = 0.004
    """The rod's radius: nodes lie at least so high above the table [m]."""
    table_z_m: float = 0.0
    """Height of the table [m]."""
    covariance_factor: float = 1.0
    """Scale of the stated covariance, from sequences with known truth."""
    cpd: CpdConfig = field(default_factory=CpdConfig)
    """The registration of DLOs that are not one chain."""

    def build(self) -> "MapObserver":
        """The strategy with these settings."""
        return MapObserver(self)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What holds for one cloud, about the prior's centre."""

    points: Array
    before: Array
    """The nodes before (M, 3) [m]."""
    rod_m: Array
    """Arc length of the nodes on the rod (M,) [m]."""
    K_d: Array
    K_x: Array
    pins: tuple[tuple[int, Array], ...]
    floor_m: float
    """Lowest z of a node [m]."""
    origin: Array
    seen: Observation


class MapObserver:
    """Coarse steps, places along the rod from the tips, fine steps, covariance."""

    def __init__(self, config: MapConfig | None = None) -> None:
        self._config = config or MapConfig()

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """The most probable nodes, their covariance (M, 3, 3) [m²], and health.

        A DLO that is not one chain of at least 4 nodes is registered by coherent point drift.
        """
        config = self._config
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        if not is_chain(prior.topology) or len(prior.nodes_world) < 4:
            first = register(thinned(points, config.cpd.max_points), prior.nodes_world, config.cpd)
            return register_visible(points, first, seen, prior, config.cpd, config.visibility)
        frame = framed(thinned(points, config.fine_points), seen, prior, config)
        nodes, before = coarse(frame, config)
        return fine(frame, nodes, before, config)


def framed(points: Array, seen: Observation, prior: DloState, config: MapConfig) -> Frame:
    """The problem of one cloud."""
    origin = prior.nodes_world.mean(axis=0)
    rest = prior.topology.rest_lengths_m
    K_d, K_x = coherence(len(prior.nodes_world), float(np.mean(rest)), config.priors)
    return Frame(
        points=points - origin,
        before=prior.nodes_world - origin,
        rod_m=np.concatenate(([0.0], np.cumsum(rest))),
        K_d=K_d,
        K_x=K_x,
        pins=tuple((pin.node, np.asarray(pin.position_world, dtype=np.float64) - origin) for pin in seen.pins),
        floor_m=config.table_z_m + config.radius_m - float(origin[2]),
        origin=origin,
        seen=seen,
    )


def coarse(frame: Frame, config: MapConfig) -> tuple[Array, Array]:
    """Nodes near the cloud, and the nodes before moved rigidly to them; both (M, 3) [m].

    Rest lengths stiffen as the Gaussian narrows: a chain that could not stretch at all would not get round.
    """
    points = thinned(frame.points, config.coarse_points)
    nodes, before = frame.before, frame.before
    share = len(nodes) / max(len(points), 1) * config.most_points
    sigma = start_width(points, nodes, config)
    while True:
        weights, sums = soft_places(points, nodes, sigma, config.outlier_ratio)
        if float(np.sum(weights)) > 1e-6:
            before = moved_rigidly(frame.before, _drawn(nodes, weights, sums), weights)
        system = _with_priors(frame, nodes, before, max(config.priors.length_m, sigma / 16), config)
        scale = min(share, 1.0) / sigma**2
        add_places(system, weights * scale, sums * scale)
        nodes = system.solve()
        if sigma <= config.narrowest_m:
            return nodes, before
        sigma = max(sigma * config.narrowing, config.narrowest_m)


def start_width(points: Array, nodes: Array, config: MapConfig) -> float:
    """How wide to begin: twice the distance of most points from the nodes before, within the limits [m]."""
    nearest = np.sqrt(np.min(squared_distances(points, nodes), axis=1))
    typical = 1.5 * float(np.quantile(nearest, 0.8))
    return float(np.clip(typical, config.narrowest_m, config.widest_m))


def _drawn(nodes: Array, weights: Array, sums: Array) -> Array:
    """Where the points draw each node: their mean, or the node itself without any."""
    return (sums + 1e-6 * nodes) / (weights + 1e-6)[:, None]


def _with_priors(frame: Frame, nodes: Array, before: Array, length_sigma_m: float, config: MapConfig) -> ChainSystem:
    """Normal equations with all that does not come from the cloud."""
    system = ChainSystem(len(nodes))
    priors = config.priors
    add_coherence(system, frame.K_d, frame.K_x, before)
    add_lengths(system, nodes, np.diff(frame.rod_m), length_sigma_m)
    add_table(system, nodes, frame.floor_m, priors.table_m)
    for node, place in frame.pins:
        add_place(system, node, place, priors.pin_m)
    return system


def fine(frame: Frame, nodes: Array, before: Array, config: MapConfig) -> TargetPoints:
    """The nodes with points on segments and tips at the ends of the cloud; with covariance and health."""
    points = frame.points
    around = first = nearest_segment(points, nodes)
    window = max(int(np.ceil(config.window_m / np.mean(np.diff(frame.rod_m)))), 1)
    tips = Tips()
    placed = assign(points, nodes, around, first, window)
    system = ChainSystem(len(nodes))
    weights = np.zeros(len(points))
    for step in range(config.fine_steps):
        sigma = config.noise_m * (2.0 if step == 0 else 1.0)
        if step in (0, 2):
            tips = find_tips(frame, nodes, placed, sigma, config)
            s = arc_lengths(nodes)
            nodes = polyline_at(nodes, s, places_along(frame.rod_m, tips))
            around = first = nearest_segment(points, nodes)
            placed = assign(points, nodes, around, first, window)
        weights = inlier_probability(placed.distance2, sigma, config.outlier_limit)
        system = _with_priors(frame, nodes, before, config.priors.length_m, config)
        full = np.bincount(placed.segment, weights, len(nodes) - 1)
        even = np.minimum(config.most_points / np.maximum(full, 1.0), 1.0)[placed.segment]
        add_points(system, nodes, points, placed.segment, np.clip(placed.t, 0.0, 1.0), weights * even / sigma**2)
        _add_tips(system, nodes, tips, config)
        nodes = system.solve()
        placed = assign(points, nodes, placed.segment, first, window)
    support = supports(placed, len(nodes), config)
    visible = support & ~shaded(nodes + frame.origin, frame.seen, config.visibility)
    covariance = system.covariance() * config.covariance_factor
    return TargetPoints(
        stamp_ns=frame.seen.stamp_ns,
        nodes_world=nodes + frame.origin,
        visible=visible,
        covariance=covariance,
        health=float(np.mean(placed.distance2 < config.visibility.radius_m**2)),
    )


def _add_tips(system: ChainSystem, nodes: Array, tips: Tips, config: MapConfig) -> None:
    """Seen tips stay where places along the rod have put them, along the rod."""
    for known, end, inner in ((tips.first_m, 0, 2), (tips.last_m, len(nodes) - 1, len(nodes) - 3)):
        if known is not None:
            direction = nodes[end] - nodes[inner]
            direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
            add_along(system, end, nodes[end], direction, config.priors.tip_m)


def find_tips(frame: Frame, nodes: Array, placed: Assignment, sigma_m: float, config: MapConfig) -> Tips:
    """The tips that the cloud shows, on the polyline of the nodes."""
    s = arc_lengths(nodes)
    lengths = np.diff(s)
    near = placed.distance2 < (config.outlier_limit * sigma_m) ** 2
    along = (s[placed.segment] + placed.t * lengths[placed.segment])[near]
    found = extent(along, float(s[-1]), config.tips)
    if found is None:
        return Tips()
    onward = np.array([0.005, 0.01, 0.015])
    ends = polyline_at(nodes, s, np.concatenate([found.start_m - onward, found.end_m + onward]))
    cut = shaded(ends + frame.origin, frame.seen, config.visibility)
    return seen_tips(found, float(frame.rod_m[-1]), bool(cut[:3].any()), bool(cut[3:].any()), config.tips)


def supports(placed: Assignment, count: int, config: MapConfig) -> Flags:
    """Which nodes (M,) have enough points at their part of the rod."""
    near = placed.distance2 < config.visibility.radius_m**2
    inside = near & (placed.t > -1.0) & (placed.t < 2.0)
    nearest = placed.segment + (placed.t > 0.5)
    counts = np.bincount(nearest[inside], minlength=count)
    return counts >= config.visibility.least_points
