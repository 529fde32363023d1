"""The two stages of the MAP observer.

The coarse stage moves the previous nodes rigidly, then into the basin of the solution. The fine stage assigns points to
segments, tips to the ends of the cloud, and nodes to arc lengths.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from dlokit.skills.observer.map.assign import MOST_POINTS, Assignment, assign, moments, nearest_segment, soft_places
from dlokit.skills.observer.map.problem import COARSE_POINTS, LENGTH_SIGMA_M, MapProblem, with_priors
from dlokit.skills.observer.map.terms import ChainSystem, add_place, add_places, add_points, add_tip
from dlokit.skills.observer.map.tips import SNAP_BLIND_M, SNAP_M, Tips, extent, places_along, seen_tips
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.visibility import LEAST_SUPPORT, SUPPORT_RADIUS_M, thickness
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array

_NARROWEST_M = 0.008
"""Width of the soft assignment at its end [m]; about a node spacing."""
_NARROWING = 0.75
"""Factor on the width from one coarse step to the next."""
_OUTLIER_RATIO = 0.1
"""Density of outliers, as a fraction of the peak of a node's Gaussian."""


@njit(cache=True)
def moved_rigidly(before: Float64Array, after: Float64Array, weights: Float64Array) -> Float64Array:
    """`before` (M, 3) [m] turned and shifted to fit `after` (M, 3) [m], by weights (M,), their sum above 0.

    R maximises tr(Rᵀ (C + kappa I)), C = sum w (after - mean) (before - mean)ᵀ (Kabsch). The roll of a
    straight rod is undetermined; kappa, a hundredth of tr C's bound, then makes R the smallest turn.
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
    """Nodes near the cloud, and the previous nodes moved rigidly to them; both (M, 3) [m].

    Points belong to nodes softly, with a Gaussian that narrows from the distance travelled since the last cloud to a
    node spacing. Rest lengths stiffen with it: an inextensible chain would not pass round bends.
    """
    points = thinned(problem.points, COARSE_POINTS)
    nodes, before = problem.before, problem.before
    weight = min(len(nodes) / len(points) * MOST_POINTS, 1.0)
    sigma = max(problem.moved_m, _NARROWEST_M)
    while True:
        weights, sums = soft_places(points, nodes, sigma, _OUTLIER_RATIO)
        drawn = (sums + 1e-6 * nodes) / (weights + 1e-6)[:, None]  # a node without points stays
        before = moved_rigidly(problem.before, drawn, weights + 1e-6)
        system = with_priors(problem, nodes, before, problem.moved_m, max(LENGTH_SIGMA_M, sigma / 16))
        add_places(system.band, system.rhs, weights, sums, weight / sigma**2)
        nodes = system.solve()
        if sigma <= _NARROWEST_M:
            return nodes, before
        sigma = max(sigma * _NARROWING, _NARROWEST_M)


_STEPS = 4
"""Gauss-Newton steps with points assigned to segments."""
_OUTLIER_LIMIT = 3.5
"""A point farther than this many standard deviations is more likely an outlier."""
_WINDOW_M = 0.05
"""A point's place along the rod changes by at most this during the steps [m]."""
_TIP_SIGMA_M = 0.001
"""Standard deviation of a seen tip from the end of the cloud, along the rod [m]."""
_FREE_SPACE_M = 0.01
"""Standard deviation of the pull of a node in open view without points to the nearest hidden place or point [m]."""
_FREE_SPACE_REACH_M = 0.05
"""Distance from which on the pull weakens [m]."""
_END_M = 0.02  # past an end the curve continues straight along its last stretch of this length


@njit(cache=True)
def arc_lengths(nodes: Float64Array) -> Float64Array:
    """Arc length of each node (M, 3) from node 0, (M,) [m]."""
    s = np.zeros(nodes.shape[0])
    for i in range(1, nodes.shape[0]):
        a, b, c = nodes[i, 0] - nodes[i - 1, 0], nodes[i, 1] - nodes[i - 1, 1], nodes[i, 2] - nodes[i - 1, 2]
        s[i] = s[i - 1] + np.sqrt(a * a + b * b + c * c)
    return s


@njit(cache=True)
def places(nodes: Float64Array, s: Float64Array, wanted_m: Float64Array) -> Float64Array:
    """Positions (n, 3) at arc lengths (n,) of the chain (M, 3) with nodes at s (M,); past an end, straight on."""
    found = np.empty((wanted_m.shape[0], 3))
    for axis in range(3):
        found[:, axis] = np.interp(wanted_m, s, nodes[:, axis])
    for end, sign in ((0, 1.0), (nodes.shape[0] - 1, -1.0)):
        inner = np.empty(3)
        for axis in range(3):
            inner[axis] = np.interp(s[end] + sign * _END_M, s, nodes[:, axis])
        away = nodes[end] - inner
        away /= max(np.sqrt(np.sum(away**2)), 1e-9)
        for n in range(wanted_m.shape[0]):
            past = sign * (s[end] - wanted_m[n])
            if past > 0.0:
                found[n] = nodes[end] + past * away
    return found


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """The most probable nodes, with the assignment of the cloud."""

    nodes: Float64Array
    """(M, 3) [m] about the problem's origin."""
    placed: Assignment
    tips: Tips
    supported: BoolArray
    """(M,) whether enough points are at the node's part of the rod."""
    shaded: BoolArray
    """(M,) whether the node is out of the picture, behind the robot, or behind the rod itself."""


def fine(problem: MapProblem, nodes: Float64Array, before: Float64Array) -> Fitted:
    """Gauss-Newton steps from the coarse `nodes`; every other step first moves the nodes to their arc lengths.

    `nodes` and those of the cloud `before` are (M, 3) [m], about the problem's origin.
    """
    points = problem.points
    window = max(int(np.ceil(_WINDOW_M / np.mean(np.diff(problem.rod_m)))), 1)
    first = nearest_segment(points, nodes)
    placed = assign(points, nodes, first, first, window)
    tips = Tips()
    for step in range(_STEPS):
        sigma = problem.noise_m * (2.0 if step == 0 else 1.0)
        if step % 2 == 0:
            tips = find_tips(problem, nodes, placed, sigma)
            wanted = places_along(problem.rod_m, tips)
            nodes, before = slid(nodes, wanted), slid(before, wanted)
            placed = assign(points, nodes, placed.segment, placed.segment, window)
            first = placed.segment
        system = with_priors(problem, nodes, before, problem.moved_m, LENGTH_SIGMA_M)
        add_cloud(system, points, nodes, placed, sigma, MOST_POINTS)
        add_tips(system, nodes, tips)
        add_free_space(system, problem, nodes, placed)
        nodes = system.solve()
        placed = assign(points, nodes, placed.segment, first, window)
    supported = supports(placed, len(nodes), problem.radius_m)
    return Fitted(
        nodes=nodes,
        placed=placed,
        tips=tips,
        supported=supported,
        shaded=problem.hidden(nodes, ~supported),
    )


def slid(nodes: Float64Array, wanted_m: Float64Array) -> Float64Array:
    """The nodes (M, 3) moved along their own curve to arc lengths (M,) [m]."""
    return places(nodes, arc_lengths(nodes), wanted_m)


def add_cloud(
    system: ChainSystem,
    points: Float64Array,
    nodes: Float64Array,
    placed: Assignment,
    sigma_m: float,
    most_points: float,
) -> None:
    """Add the points (N, 3) [m] on their segments of `nodes` (M, 3) [m].

    Weight p / sigma², p the inlier probability, at most `most_points` a segment.
    """
    sums = moments(
        points,
        placed.segment,
        placed.t,
        placed.distance2,
        len(nodes) - 1,
        sigma_m,
        _OUTLIER_LIMIT,
        most_points,
    )
    add_points(system.band, system.rhs, nodes, sums)


def add_tips(system: ChainSystem, nodes: Float64Array, tips: Tips) -> None:
    """Add terms that keep the seen tips of the nodes (M, 3) [m] at their arc lengths from `places_along`."""
    last = len(nodes) - 1
    for known, end, inner in ((tips.first_m, 0, 2), (tips.last_m, last, last - 2)):
        if known is not None:
            add_tip(system.band, system.rhs, nodes, end, inner, _TIP_SIGMA_M)


def add_free_space(system: ChainSystem, problem: MapProblem, nodes: Float64Array, placed: Assignment) -> None:
    """Add terms that draw nodes (M, 3) [m] in open view without points to the nearest hidden place or point of the rod.

    They are added only if the occlusion of the rod is known, with a robust loss (Geman-McClure): standard
    deviation free_space (1 + d² / reach²) at distance d.
    """
    if problem.view is None or not problem.view.occlusion_known:
        return
    unsupported = ~supports(placed, len(nodes), problem.radius_m)
    alone = np.flatnonzero(unsupported & ~problem.hidden(nodes, unsupported))
    rod = problem.points[placed.distance2 < (SUPPORT_RADIUS_M * thickness(problem.radius_m)) ** 2]
    if len(alone) == 0 or len(rod) == 0:
        return
    reach = _FREE_SPACE_REACH_M
    for node in alone.tolist():
        away = rod - nodes[node]
        squared = np.einsum("ij,ij->i", away, away)
        at = int(np.argmin(squared))
        place, far2 = rod[at], float(squared[at])
        shade = problem.view.nearest_shade(nodes[node], min(np.sqrt(far2), 2.0 * reach))
        if shade is not None:
            place, far2 = shade, float(np.sum((shade - nodes[node]) ** 2))
        add_place(system.band, system.rhs, node, place, _FREE_SPACE_M * (1.0 + far2 / reach**2))


def find_tips(problem: MapProblem, nodes: Float64Array, placed: Assignment, sigma_m: float) -> Tips:
    """The tips that the cloud shows, on the polyline of the nodes (M, 3) [m]."""
    s = arc_lengths(nodes)
    near = placed.distance2 < (_OUTLIER_LIMIT * sigma_m) ** 2
    along = (s[placed.segment] + placed.t * np.diff(s)[placed.segment])[near]
    found = extent(along, float(s[-1]))
    if found is None:
        return Tips()
    onward = np.array([0.005, 0.01, 0.015])  # hidden within a node spacing
    ends = places(nodes, s, np.concatenate([found.start_m - onward, found.end_m + onward]))
    cut = problem.shaded(ends)
    occlusion_known = problem.view is not None and problem.view.occlusion_known
    snap_m = SNAP_M if occlusion_known else SNAP_BLIND_M
    return seen_tips(found, float(problem.rod_m[-1]), bool(cut[:3].any()), bool(cut[3:].any()), snap_m)


def supports(placed: Assignment, count: int, radius_m: float) -> BoolArray:
    """Which nodes (count,) have enough points at their part of the rod of `radius_m` [m]."""
    support_m = SUPPORT_RADIUS_M * thickness(radius_m)
    return _supporting(placed.segment, placed.t, placed.distance2, support_m, count) >= LEAST_SUPPORT


@njit(cache=True)
def _supporting(
    segment: Int64Array, t: Float64Array, distance2: Float64Array, radius_m: float, count: int
) -> Int64Array:
    """Number of points at each node's part of the rod, (count,)."""
    found = np.zeros(count, dtype=np.int64)
    for n in range(segment.shape[0]):
        if distance2[n] < radius_m**2 and -1.0 < t[n] < 2.0:
            found[segment[n] + (1 if t[n] > 0.5 else 0)] += 1
    return found
