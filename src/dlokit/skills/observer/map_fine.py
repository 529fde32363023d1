"""The fine stage of the MAP observer: points on segments, tips at the ends of the cloud."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.geometry import arc_lengths
from dlokit.skills.observer.curve import polyline_at
from dlokit.skills.observer.map_assign import Assignment, assign, inlier_probability, nearest_segment
from dlokit.skills.observer.map_frame import Frame, with_priors
from dlokit.skills.observer.map_settings import MapSettings
from dlokit.skills.observer.map_solver import ChainSystem
from dlokit.skills.observer.map_terms import add_along, add_place, add_points
from dlokit.skills.observer.map_tips import Tips, extent, places_along, seen_tips
from dlokit.skills.observer.mixture import squared_distances
from dlokit.skills.observer.visibility import shaded

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """The most probable nodes, and what the cloud said at the end."""

    nodes: Array
    """(M, 3) [m] about the frame's origin."""
    placed: Assignment
    tips: Tips
    supported: Flags
    """(M,) whether enough points lie at the node's part of the rod."""
    shaded: Flags
    """(M,) whether the node is out of the picture or behind the robot."""


def fine(frame: Frame, nodes: Array, before: Array, config: MapSettings) -> Fitted:
    """Gauss-Newton from the coarse nodes; every other step begins with the nodes at their places from the tips."""
    points = frame.points
    window = max(int(np.ceil(config.window_m / np.mean(np.diff(frame.rod_m)))), 1)
    first = nearest_segment(points, nodes)
    placed = assign(points, nodes, first, first, window)
    tips = Tips()
    for step in range(config.fine_steps):
        sigma = config.noise_m * (2.0 if step == 0 else 1.0)
        if step % 2 == 0:
            tips = find_tips(frame, nodes, placed, sigma, config)
            nodes = polyline_at(nodes, arc_lengths(nodes), places_along(frame.rod_m, tips))
            first = nearest_segment(points, nodes)
            placed = assign(points, nodes, first, first, window)
        system = with_priors(frame, nodes, before, frame.way_m, config.priors.length_m, config)
        add_cloud(system, points, nodes, placed, sigma, config.most_points, config)
        add_tips(system, nodes, tips, config.priors.tip_m)
        add_free_space(system, frame, nodes, placed, config)
        nodes = system.solve()
        placed = assign(points, nodes, placed.segment, first, window)
    return Fitted(
        nodes=nodes,
        placed=placed,
        tips=tips,
        supported=supports(placed, len(nodes), config),
        shaded=shaded(nodes + frame.origin, frame.seen, config.visibility),
    )


def add_cloud(
    system: ChainSystem,
    points: Array,
    nodes: Array,
    placed: Assignment,
    sigma_m: float,
    most_points: float,
    config: MapSettings,
) -> None:
    """The points on their segments: weight p / sigma², p the inlier probability, at most `most_points` a segment."""
    inlier = inlier_probability(placed.distance2, sigma_m, config.outlier_limit)
    inlier = np.where((placed.t < -1.0) | (placed.t > 2.0), 0.0, inlier)  # far past an end; t is within [0, 1] inside
    full = np.bincount(placed.segment, inlier, len(nodes) - 1)
    even = np.minimum(most_points / np.maximum(full, 1.0), 1.0)[placed.segment]
    add_points(system, nodes, points, placed.segment, np.clip(placed.t, 0.0, 1.0), inlier * even / sigma_m**2)


def add_tips(system: ChainSystem, nodes: Array, tips: Tips, sigma_m: float) -> None:
    """Seen tips stay where `places_along` has put them, along the rod."""
    for known, end, inner in ((tips.first_m, 0, 2), (tips.last_m, len(nodes) - 1, len(nodes) - 3)):
        if known is not None:
            direction = nodes[end] - nodes[inner]
            add_along(system, end, nodes[end], direction / max(float(np.linalg.norm(direction)), 1e-9), sigma_m)


def add_free_space(system: ChainSystem, frame: Frame, nodes: Array, placed: Assignment, config: MapSettings) -> None:
    """Nodes in open view without points cannot be there: each is drawn to the nearest point of the rod.

    Only where the picture tells what hides the rod. Robustly (Geman-McClure): standard deviation
    free_space (1 + d² / reach²) at distance d.
    """
    if frame.seen.calibration is None or frame.seen.occlusion is None:
        return
    alone = np.flatnonzero(~supports(placed, len(nodes), config))
    alone = alone[~shaded(nodes[alone] + frame.origin, frame.seen, config.visibility)]
    rod = frame.points[placed.distance2 < config.visibility.radius_m**2]
    if len(alone) == 0 or len(rod) == 0:
        return
    squared = squared_distances(nodes[alone], rod)
    nearest = np.argmin(squared, axis=1)
    for k, node in enumerate(alone.tolist()):
        robust = 1.0 + float(squared[k, nearest[k]]) / config.free_space_reach_m**2
        add_place(system, node, rod[nearest[k]], config.free_space_m * robust)


def find_tips(frame: Frame, nodes: Array, placed: Assignment, sigma_m: float, config: MapSettings) -> Tips:
    """The tips that the cloud shows, on the polyline of the nodes (M, 3) [m]."""
    s = arc_lengths(nodes)
    near = placed.distance2 < (config.outlier_limit * sigma_m) ** 2
    along = (s[placed.segment] + placed.t * np.diff(s)[placed.segment])[near]
    found = extent(along, float(s[-1]), config.tips)
    if found is None:
        return Tips()
    onward = np.array([0.005, 0.01, 0.015])  # hidden within a node spacing
    ends = polyline_at(nodes, s, np.concatenate([found.start_m - onward, found.end_m + onward]))
    cut = shaded(ends + frame.origin, frame.seen, config.visibility)
    return seen_tips(found, float(frame.rod_m[-1]), bool(cut[:3].any()), bool(cut[3:].any()), config.tips)


def supports(placed: Assignment, count: int, config: MapSettings) -> Flags:
    """Which nodes (count,) have enough points at their part of the rod."""
    near = (placed.distance2 < config.visibility.radius_m**2) & (placed.t > -1.0) & (placed.t < 2.0)
    nearest = placed.segment + (placed.t > 0.5)
    return np.bincount(nearest[near], minlength=count) >= config.visibility.least_points
