"""The first shape: a cloud of unknown order becomes nodes, with no prior.

Contract the cloud to a skeleton, cut it where it branches, order the pieces along the path with the least bending
and the rod's length (`ordering`), and fit a smooth centre line along that path. Node 0 is the
end farther to the robot's left (larger y in the world); of two ends within 2 cm in y, the one nearer to the
robot's base (smaller x).

The lengths here, in `skeleton`, `ordering` and `curve` are for a DLO of 4 mm radius. A thicker DLO is scaled
down to that radius before it is ordered, so that all these lengths are multiples of its radius.
"""

import numpy as np
import scipy

from dlokit.errors import SkillFailure
from dlokit.geometry import arc_lengths, resample, rmse_m
from dlokit.skills.observer.curve import FittedCurve, fit_curve, project
from dlokit.skills.observer.initialise.ordering import Route, faces_itself, links, polyline, routes
from dlokit.skills.observer.initialise.skeleton import skeleton
from dlokit.skills.observer.visibility import RADIUS_M, shaded, supported, thickness
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import TargetPoints
from dlokit.types.observation import Observation

_LEAST_POINTS = 60
"""A cloud with fewer points than this shows no DLO."""
ISOLATION_RADIUS_M = 0.01
"""A point with less than a quarter of the usual number of points in this radius is an outlier [m]."""
_MOST_PIECES = 24
"""A skeleton with more pieces than this shows an area or several objects."""
_BRANCH_M = 0.03
"""Largest total length of pieces outside the rod [m]; longer ones are not outliers."""
_AMBIGUITY = 6.0
"""Two orders whose costs differ by less than this are indistinguishable [1/m]; see `ordering`."""
_SAME_ORDER_M = 0.01
"""Two orders whose curves differ by less than this are the same [m], root mean square."""
_TOO_MANY = ("fragmented", "crossing")
"""Failures that a thicker rod causes: each of its sides looks like a rod."""
_THICKER = 1.6
"""Least ratio of shown to given thickness that counts as thicker; 3 mm of noise give a thin rod a ratio of 1.5."""
_WIDE, _MOST_WIDE = 1.5, 0.4
"""Largest distance of a rod's points from its line, in radii (two strands: 2), and the fraction that may exceed it."""
_AROUND_M = tuple(0.012 * 1.5**step for step in range(7))
"""Neighbourhoods in which the radius is measured [m]: the largest is enough for a radius of 50 mm."""
_LINE = 0.4
"""A neighbourhood shows a line where the measured radius is below this fraction of its own; in an area it is 0.7."""
LENGTH_TOLERANCE = 0.06
"""The curve may be shorter or longer than the rod by this fraction of its length: more than for a goal, since noise
and hidden ends shorten a curve."""
_GAP_FRACTION = 0.14
"""A link between pieces may cross a gap of at most this fraction of the rod's length."""
_REACH_M = 0.006
"""Points farther from the skeleton than this do not belong to the curve [m]. The skeleton ends where the rod ends: a
longer reach would include points of another part of the rod."""


def initial_targets(
    seen: Observation,
    count: int,
    length_m: float | None,
    prior_nodes: Float64Array | None = None,
    radius_m: float = RADIUS_M,
    *,
    given: bool = False,
) -> TargetPoints:
    """Order the cloud into `count` nodes along a rod of known length [m]; None: the length that the cloud shows.

    `radius_m` [m] is the rod's. A cloud that cannot be ordered and shows a thicker rod is ordered as a thicker rod,
    unless the radius is `given` and the length is not: then it may show two strands side by side, which are refused.
    With `prior_nodes` (count, 3) [m] the order is the one nearer to them; else node 0 is the end farther to
    the left (see the module). Nodes in a gap are marked not visible. Raises `SkillFailure` with reason
    ``no_points``, ``out_of_view`` (an end is cut off by the picture or the robot, or much of the rod is missing),
    ``crossing`` (the rod lies across or against itself and more than one order is possible) or
    ``fragmented`` (pieces too far apart or too many to be one rod).
    """
    scale, narrow = thickness(radius_m), given and length_m is None
    try:
        return _in_order(seen, count, length_m, prior_nodes, scale, narrow)
    except SkillFailure as failure:
        shown = thickness(shown_radius_m(seen.points_world.astype(np.float64))) if failure.reason in _TOO_MANY else 0.0
        if narrow or shown < _THICKER * scale:
            raise
    return _in_order(seen, count, length_m, prior_nodes, shown, narrow)


def _in_order(
    seen: Observation, count: int, length_m: float | None, prior_nodes: Float64Array | None, scale: float, narrow: bool
) -> TargetPoints:
    """`initial_targets` of a rod that is `scale` times as thick as the 4 mm rod of this module's lengths.

    `narrow`: two strands side by side are refused.
    """
    points = np.asarray(seen.points_world, dtype=np.float64)
    kept = without_isolated_points(points / scale)
    if len(kept) < _LEAST_POINTS:
        raise SkillFailure(
            "no_points",
            f"{len(kept)} points of the DLO in the cloud, at least {_LEAST_POINTS} are needed; "
            f"is it in view, and do the filters fit its colour?",
        )
    rod_m = None if length_m is None else length_m / scale
    curve = fit_curve(kept, _ordered(kept, rod_m, scale), reach_m=_REACH_M, iterations=2)
    if curve is None:
        raise SkillFailure("fragmented", "no curve runs through the points; look again")
    if length_m is not None:
        _check_length(curve, length_m, seen, scale)
    if narrow and (wide := _wide(curve.points, kept)) > _MOST_WIDE:
        raise SkillFailure(
            "crossing",
            f"{wide:.0%} of the curve's cloud is wider than a DLO of {2000.0 * scale * RADIUS_M:.0f} mm: strands lie "
            "side by side, or it is thicker; lay it out, correct the radius, or give the length",
        )
    nodes = scale * curve.at(np.linspace(curve.segments[0].start_m, curve.segments[-1].end_m, count))
    span = scale * (curve.segments[-1].end_m - curve.segments[0].start_m)
    fit = 1.0 if length_m is None else 1.0 - abs(span / length_m - 1.0)
    nodes = oriented(nodes, prior_nodes)
    return TargetPoints(
        stamp_ns=seen.stamp_ns,
        nodes_world=nodes,
        visible=supported(nodes / scale, kept),
        health=float(np.mean(curve.used)) * len(kept) / len(points) * fit,
    )


def _wide(line: Float64Array, points: Float64Array) -> float:
    """The fraction of a line (K, 3) [m] beside which a tenth of the points (N, 3) [m] are too far for one rod."""
    s, apart_m = project(points, line)
    bins = np.floor(s / (5.0 * RADIUS_M))
    found = [apart_m[(bins == one) & (apart_m < 4.0 * RADIUS_M)] for one in np.unique(bins)]
    return float(np.mean([np.quantile(part, 0.9) > _WIDE * RADIUS_M for part in found if len(part) > 4]))


def oriented(nodes: Float64Array, prior_nodes: Float64Array | None = None) -> Float64Array:
    """The nodes (M, 3) [m] in the prior's direction, or from the end farther to the left (larger y), see the module."""
    if prior_nodes is not None and len(prior_nodes) == len(nodes):
        return nodes if rmse_m(nodes, prior_nodes) <= rmse_m(nodes[::-1], prior_nodes) else nodes[::-1].copy()
    first, last = nodes[0], nodes[-1]
    if abs(first[1] - last[1]) > 0.02:
        return nodes if first[1] > last[1] else nodes[::-1].copy()
    return nodes if first[0] <= last[0] else nodes[::-1].copy()


def without_isolated_points(points: Float64Array) -> Float64Array:
    """The points (N, 3) [m] with enough neighbours."""
    if len(points) == 0:
        return points
    counts = np.asarray(scipy.spatial.KDTree(points).query_ball_point(points, ISOLATION_RADIUS_M, return_length=True))
    return points[counts > 0.25 * np.median(counts)]


def shown_radius_m(points: Float64Array) -> float:
    """The radius [m] of the rod that the points (N, 3) [m] show, from their spread across it; 0 if they show no rod.

    The spread is taken in the smallest neighbourhood that is longer than the rod is wide. Points on the side of the
    surface that a camera sees have the standard deviation radius / √2 across.
    """
    tree, drawn = scipy.spatial.KDTree(points), points[:: max(len(points) // 200, 1)]
    for around_m in _AROUND_M:
        near = [points[index] for index in tree.query_ball_point(drawn, around_m) if len(index) > 3]
        across = [np.linalg.eigvalsh(np.cov(part.T))[1] for part in near]  # the second largest variance
        if across and (radius_m := float(np.sqrt(2.0 * np.median(across)))) < _LINE * around_m:
            return radius_m
    return 0.0


def _ordered(points: Float64Array, length_m: float | None, scale: float) -> Float64Array:
    """A line (K, 3) along the rod, from tip to tip, through the points (N, 3); all lengths in units of `scale` m."""
    pieces = skeleton(points)
    if not pieces:
        raise SkillFailure("fragmented", f"the {len(points)} points of the cloud form no line; are they in metres?")
    if len(pieces) > _MOST_PIECES:
        raise SkillFailure(
            "fragmented",
            f"the cloud falls into {len(pieces)} pieces of line, at most {_MOST_PIECES} are allowed: it shows an "
            f"area or many objects, if the DLO is {2000.0 * scale * RADIUS_M:.0f} mm thick; check the box, the "
            f"segmentation and the radius",
        )
    rod_m = length_m or sum(float(arc_lengths(piece)[-1]) for piece in pieces)
    joined = links(pieces, points, _GAP_FRACTION * rod_m)
    found = routes(pieces, joined, length_m, _AMBIGUITY)
    best = polyline(found[0], pieces, joined)
    _check_omitted(found[0], pieces, best, scale)
    if faces_itself(best):
        raise SkillFailure("crossing", "the rod's ends touch, so that it has no beginning; lay them apart")
    for other in found[1:]:
        line = polyline(other, pieces, joined)
        if rmse_m(resample(best, 50), resample(line, 50), ends_interchangeable=True) >= _SAME_ORDER_M:
            raise SkillFailure(
                "crossing",
                "the rod lies across or against itself and two orders are equally likely; lay it out",
            )
    return best


def _check_omitted(route: Route, pieces: list[Float64Array], line: Float64Array, scale: float) -> None:
    """Raise ``fragmented`` or ``crossing`` when a large part of the skeleton is not part of the rod."""
    others = [piece for number, piece in enumerate(pieces) if number not in route.pieces]
    omitted_m = sum(float(arc_lengths(piece)[-1]) for piece in others)
    if omitted_m <= _BRANCH_M:
        return
    apart_m = float(np.min(scipy.spatial.KDTree(line).query(np.vstack(others))[0]))
    if apart_m > 0.02:
        raise SkillFailure(
            "fragmented",
            f"{scale * omitted_m:.2f} m of the visible line are {scale * apart_m * 1000:.0f} mm from the rest; "
            f"something hides the rod between them, or there is more than one: clear the view and look again",
        )
    raise SkillFailure(
        "crossing",
        f"{scale * omitted_m:.2f} m of the visible line branch off the rod; it lies across itself, or an object of "
        f"its colour is there: lay it out without loops",
    )


def _check_length(curve: FittedCurve, length_m: float, seen: Observation, scale: float) -> None:
    """Raise ``out_of_view`` when the curve is too short, ``crossing`` when it is too long to be one rod."""
    start, end = curve.segments[0].start_m, curve.segments[-1].end_m
    span = scale * (end - start)
    if span > (1.0 + LENGTH_TOLERANCE) * length_m:
        raise SkillFailure(
            "crossing",
            f"the curve is {span:.3f} m long, the rod {length_m:.3f} m; something else lies in the cloud, "
            f"or the configured length is wrong",
        )
    if span >= (1.0 - LENGTH_TOLERANCE) * length_m:
        return
    onward = np.array([0.005, 0.01, 0.015])
    cut = [bool(np.any(shaded(scale * curve.at(s), seen))) for s in (start - onward, end + onward)]
    where = "at the border of the picture or behind the robot" if any(cut) else "by the box filter, or unseen"
    raise SkillFailure(
        "out_of_view",
        f"only {span:.3f} m of the {length_m:.3f} m long rod are seen, the rest is cut off {where}; "
        f"lay it into view, or correct the configured length",
    )
