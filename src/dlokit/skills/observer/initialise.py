"""The first shape: a cloud of unknown order becomes nodes, with no prior.

Thin the cloud, join neighbours by a minimum spanning tree, take the tree's longest path, and let the smooth
centre line around it be the rod. Node 0 is the end farther to the robot's left (larger y in the world); of
two ends within 2 cm in y, the one nearer to the robot's base (smaller x).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import KDTree

from dlokit.errors import SkillFailure
from dlokit.geometry import rmse_m
from dlokit.skills.observer.curve import CurveConfig, FittedCurve, fit_curve, project
from dlokit.skills.observer.visibility import VisibilityConfig, shaded
from dlokit.types.dlo import TargetPoints
from dlokit.types.observation import Observation

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class InitialiseConfig:
    """How the first cloud is ordered."""

    voxel_m: float = 0.006
    """The cloud is thinned to one point in a cube of this edge [m]; about the rod's diameter."""
    least_points: int = 60
    """Fewer points than this are no DLO."""
    lone_radius_m: float = 0.01
    """A point with less than a quarter of the usual number of points in this radius is an outlier [m]."""
    bridge_m: float = 0.04
    """A gap up to this is bridged [m]."""
    stray_share: float = 0.12
    """Pieces with a smaller share of the points than this are outliers; larger ones are parts of the rod."""
    branch_m: float = 0.03
    """A stretch of points beside the centre line longer than this means that the rod lies across itself [m]."""
    touch_m: float = 0.012
    """Two places of the rod nearer than this touch [m]; about one and a half diameters."""
    length_tolerance: float = 0.12
    """The curve may be shorter or longer than the rod by this share."""
    curve: CurveConfig = field(default_factory=CurveConfig)
    """The fit of the centre line."""
    visibility: VisibilityConfig = field(default_factory=VisibilityConfig)
    """What tells that an end lies at the border of the picture or behind the robot."""


def initial_targets(
    seen: Observation,
    count: int,
    length_m: float | None,
    config: InitialiseConfig | None = None,
    prior_nodes: Array | None = None,
) -> TargetPoints:
    """The cloud as `count` nodes in order along a rod of known length [m]; with None, whatever length is seen.

    With `prior_nodes` (count, 3) [m] the order is the one nearer to them; else node 0 is the end farther to
    the left (see the module). Raises `SkillFailure` with reason ``no_points``, ``out_of_view``
    (an end is cut off by the picture or the robot, or much of the rod is missing), ``crossing`` (the rod
    lies across or against itself) or ``fragmented`` (pieces too far apart to be one rod).
    """
    config = config or InitialiseConfig()
    points = np.asarray(seen.points_world, dtype=np.float64)
    kept = without_lone_points(points, config)
    if len(kept) < config.least_points:
        raise SkillFailure(
            "no_points",
            f"{len(kept)} points of the DLO in the cloud, at least {config.least_points} are needed; "
            f"is it in view, and do the filters fit its colour?",
        )
    thin = thinned_by_voxel(kept, config.voxel_m)
    path = _longest_path(thin, config)
    curve = fit_curve(kept, _relaxed(thin[path]), config.curve)
    if curve is None:
        raise SkillFailure("fragmented", "no curve runs through the points; look again")
    _check_crossing(kept, curve, config)
    if length_m is not None:
        _check_length(curve, length_m, seen, config)
    nodes = curve.at(np.linspace(curve.segments[0].start_m, curve.segments[-1].end_m, count))
    span = curve.segments[-1].end_m - curve.segments[0].start_m
    fit = 1.0 if length_m is None else 1.0 - abs(span / length_m - 1.0)
    return TargetPoints(
        stamp_ns=seen.stamp_ns,
        nodes_world=oriented(nodes, prior_nodes),
        visible=np.ones(count, dtype=np.bool_),
        health=float(np.mean(curve.used)) * len(kept) / len(points) * fit,
    )


def oriented(nodes: Array, prior_nodes: Array | None = None) -> Array:
    """The nodes in the prior's direction, or from the end farther to the left (larger y), see the module."""
    if prior_nodes is not None and len(prior_nodes) == len(nodes):
        return nodes if rmse_m(nodes, prior_nodes) <= rmse_m(nodes[::-1], prior_nodes) else nodes[::-1].copy()
    first, last = nodes[0], nodes[-1]
    if abs(first[1] - last[1]) > 0.02:
        return nodes if first[1] > last[1] else nodes[::-1].copy()
    return nodes if first[0] <= last[0] else nodes[::-1].copy()


def without_lone_points(points: Array, config: InitialiseConfig) -> Array:
    """The points (N, 3) [m] that have enough others around them."""
    if len(points) == 0:
        return points
    counts = np.asarray(KDTree(points).query_ball_point(points, config.lone_radius_m, return_length=True))
    return points[counts > 0.25 * np.median(counts)]


def thinned_by_voxel(points: Array, voxel_m: float) -> Array:
    """The mean (K, 3) of the points in each occupied cube."""
    _, cube, counts = np.unique(
        np.floor(points / voxel_m).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    cube = cube.reshape(-1)
    return np.column_stack([np.bincount(cube, weights=points[:, axis]) / counts for axis in range(3)])


def _longest_path(points: Array, config: InitialiseConfig) -> Indices:
    """Indices along the longest path of the minimum spanning tree of the points (K, 3)."""
    tree = spanning_tree(points, config.bridge_m)
    pieces, label = connected_components(tree, directed=False)
    sizes = np.bincount(label, minlength=pieces)
    large = np.flatnonzero(sizes >= config.stray_share * len(points))
    if len(large) > 1:
        raise SkillFailure(
            "fragmented",
            f"{len(large)} pieces lie more than {config.bridge_m * 1000:.0f} mm apart; something hides the "
            f"rod between them, or there is more than one: clear the view and look again",
        )
    start = int(np.flatnonzero(label == np.argmax(sizes))[0])
    one_end = _farthest(tree, start)[0]
    other_end, before = _farthest(tree, one_end)
    path = [other_end]
    while path[-1] != one_end:
        path.append(int(before[path[-1]]))
    return np.array(path, dtype=np.int64)


def spanning_tree(points: Array, longest_m: float) -> csr_matrix:
    """The minimum spanning tree (K, K) of the points, or forest, by edges up to `longest_m`, weights [m]."""
    edges = KDTree(points).query_pairs(longest_m, output_type="ndarray")
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    graph = coo_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(len(points), len(points)))
    return csr_matrix(minimum_spanning_tree(graph.tocsr()))


def _farthest(tree: csr_matrix, start: int) -> tuple[int, Indices]:
    """The point farthest from `start` along the tree, and each point's predecessor (K,)."""
    distance, before = dijkstra(tree, directed=False, indices=start, return_predecessors=True)
    distance = np.where(np.isfinite(distance), distance, -1.0)
    return int(np.argmax(distance)), np.asarray(before, dtype=np.int64)


def _relaxed(path: Array) -> Array:
    """The zigzag of a path through a thick cloud, evened out; its ends stay."""
    relaxed = path.copy()
    for _ in range(4):
        relaxed[1:-1] = (relaxed[:-2] + relaxed[1:-1] + relaxed[2:]) / 3.0
    return relaxed


def _check_crossing(points: Array, curve: FittedCurve, config: InitialiseConfig) -> None:
    """Raise ``crossing`` when points branch off the curve or the curve comes near itself again."""
    low, high = curve.segments[0].start_m, curve.segments[-1].end_m
    inside = curve.points[(curve.s_m >= low) & (curve.s_m <= high)]
    s = curve.s_m[(curve.s_m >= low) & (curve.s_m <= high)]
    pairs = KDTree(inside).query_pairs(config.touch_m, output_type="ndarray")
    if len(pairs) > 0 and bool(np.any(np.abs(s[pairs[:, 0]] - s[pairs[:, 1]]) > 4 * config.touch_m)):
        raise SkillFailure("crossing", "the rod touches or crosses itself; lay it out without loops")
    beside = points[project(points, curve.points)[1] > config.touch_m]
    if len(beside) < 5:
        return
    _, label = connected_components(spanning_tree(beside, config.voxel_m * 2), directed=False)
    for piece in range(int(label.max()) + 1):
        member = beside[label == piece]
        if len(member) >= 10 and float(np.linalg.norm(np.ptp(member, axis=0))) > config.branch_m:
            raise SkillFailure(
                "crossing",
                f"{len(member)} points branch off the rod near ({member[0, 0]:.2f}, {member[0, 1]:.2f}) m; "
                f"it lies across itself, or something of its colour lies there: lay it out without loops",
            )


def _check_length(curve: FittedCurve, length_m: float, seen: Observation, config: InitialiseConfig) -> None:
    """Raise ``out_of_view`` when the curve is too short, ``crossing`` when it is too long to be one rod."""
    start, end = curve.segments[0].start_m, curve.segments[-1].end_m
    span = end - start
    if span > (1.0 + config.length_tolerance) * length_m:
        raise SkillFailure(
            "crossing",
            f"the curve is {span:.3f} m long, the rod {length_m:.3f} m; something else lies in the cloud, "
            f"or the configured length is wrong",
        )
    if span >= (1.0 - config.length_tolerance) * length_m:
        return
    onward = np.array([0.005, 0.01, 0.015])
    cut = [bool(np.any(shaded(curve.at(s), seen, config.visibility))) for s in (start - onward, end + onward)]
    where = "at the border of the picture or behind the robot" if any(cut) else "by the box filter, or unseen"
    raise SkillFailure(
        "out_of_view",
        f"only {span:.3f} m of the {length_m:.3f} m long rod are seen, the rest is cut off {where}; "
        f"lay it into view, or correct the configured length",
    )
