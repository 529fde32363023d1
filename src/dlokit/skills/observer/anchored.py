"""Coherent point drift, followed by a correction of the nodes' arc lengths; hidden nodes follow their neighbours.

A mixture fits the curve, but its nodes can slide along it by centimetres. The rod's length determines
their positions: if a tip is seen, node i is at arc length i / (M - 1) of the rod's length from it.

It is kept for one row of `dlokit bench observers`: with nothing hidden and no gripper known, its node error is 1.8 mm
at 12 ms per cloud; `map` has 2.0 mm at 1.2 ms (10 seeds, 50 frames; paired difference 0.0 to 0.4 mm).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from dlokit.geometry import arc_lengths
from dlokit.ranges import Fraction, NotNegative, check_ranges
from dlokit.rod.believed import BelievedDlo, in_a_row
from dlokit.skills.observer.base import ObserverStrategy, nothing_seen
from dlokit.skills.observer.cpd import PLIABLE, register, register_visible
from dlokit.skills.observer.curve import FittedCurve, Segment, fit_curve, project
from dlokit.skills.observer.mixture import thinned
from dlokit.skills.observer.visibility import RADIUS_M, shaded, visible_nodes
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class AnchoredConfig:
    """Coherent point drift, with nodes held at their arc length from the tips and pins that are seen."""

    name: ClassVar[str] = "anchored"

    length_tolerance: Fraction = 0.06
    """Both tips count as seen when the seen curve is shorter or longer than the rod by at most this fraction."""
    tip_snap_m: NotNegative = 0.03
    """An end of a curve that is too short counts as a tip within this distance of a registered tip [m]."""

    def __post_init__(self) -> None:
        check_ranges(self, "observer.strategy")

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        """Build the strategy with these settings."""
        return Anchored(self, dlo.radius_m)


def fill_hidden(nodes: Float64Array, known: BoolArray, prior: Float64Array) -> Float64Array:
    """The nodes (M, 3) [m], with the unknown ones moved like their `known` (M,) neighbours from the `prior`.

    Between known nodes the displacement from the prior is interpolated without overshoot; past the last
    known node the prior's end is carried along rigidly with the last few known ones. With no known node the
    prior is returned.
    """
    index = np.flatnonzero(known)
    if len(index) == len(nodes):
        return nodes
    if len(index) == 0:
        return prior.copy()
    result = nodes.copy()
    first, last = index[0], index[-1]
    inner = np.arange(first, last + 1)[~known[first : last + 1]]
    if len(inner) > 0:
        moved = scipy.interpolate.PchipInterpolator(index, nodes[index] - prior[index])
        result[inner] = prior[inner] + moved(inner)
    if first > 0:
        result[:first] = _carried(prior[:first], prior[index[:4]], nodes[index[:4]])
    if last < len(nodes) - 1:
        result[last + 1 :] = _carried(prior[last + 1 :], prior[index[-4:]], nodes[index[-4:]])
    return result


def _carried(part: Float64Array, before: Float64Array, after: Float64Array) -> Float64Array:
    """Move `part` (n, 3) by the turn about z and the shift that best bring `before` to `after`.

    The turn is about z alone: a rod on a table cannot roll, and few nodes in a row do not determine other turns.
    """
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    angle = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2]))
    cosine, sine = np.cos(angle), np.sin(angle)
    R = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return (part - before.mean(axis=0)) @ R.T + after.mean(axis=0)


@dataclass(frozen=True, kw_only=True)
class Anchor:
    """A point of the fitted curve with a known arc length on the rod."""

    s_m: float
    """Arc length on the fitted curve [m]."""
    rod_m: float
    """Arc length on the rod, from node 0 [m]."""


class Anchored:
    """Registers the nodes, fits the centre line, anchors tips and pins, and places the nodes by arc length.

    Hidden nodes follow the prior.
    """

    def __init__(self, config: AnchoredConfig | None = None, radius_m: float = RADIUS_M) -> None:
        self._config, self._radius_m = config or AnchoredConfig(), radius_m

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        """Target points in order along the rod.

        A DLO that is not one chain is registered without anchors. Health is the fraction of the cloud that
        is on the curve, reduced if the curve is too long for the rod.
        """
        points = np.asarray(seen.points_world, dtype=np.float64)
        if len(points) == 0:
            return nothing_seen(seen, prior)
        config = self._config
        drifted = register(thinned(points, PLIABLE.max_points), prior.nodes_world, PLIABLE)
        curve = fit_curve(points, drifted.nodes, radius_m=self._radius_m) if is_chain(prior.topology) else None
        if curve is None:
            return register_visible(points, drifted, seen, prior, PLIABLE, self._radius_m)
        rod_m = np.concatenate(([0.0], np.cumsum(prior.topology.rest_lengths_m)))
        s_m, covered = node_places(curve, drifted.nodes, rod_m, seen, config)
        nodes = curve.at(s_m)
        visible = covered & visible_nodes(nodes, points, seen, self._radius_m)
        known = visible.copy()
        for pin in seen.pins:
            nodes[pin.node], known[pin.node] = pin.position_world, True
        return TargetPoints(
            stamp_ns=seen.stamp_ns,
            nodes_world=fill_hidden(nodes, known, prior.nodes_world),
            visible=visible,
            health=_health(curve, float(rod_m[-1]), config),
        )


def is_chain(topology: Topology) -> bool:
    """Whether the edges join node 0 to 1 to 2 and so on."""
    first = np.arange(len(topology.edges))
    return len(first) > 0 and bool(np.array_equal(topology.edges, np.column_stack([first, first + 1])))


def node_places(
    curve: FittedCurve, drifted: Float64Array, rod_m: Float64Array, seen: Observation, config: AnchoredConfig
) -> tuple[Float64Array, BoolArray]:
    """Arc length of each node on the curve (M,) [m], and whether that point was seen (M,).

    `rod_m` (M,) are the nodes' arc lengths on the rod. Every seen stretch of the curve maps to the rod by
    its own anchors; a stretch without anchors takes its offset from the nearest anchors, or from the registration.
    """
    anchors = _tips(curve, drifted, rod_m, seen, config) + _pin_anchors(curve, rod_m, seen)
    anchors.sort(key=lambda anchor: anchor.s_m)
    offset = _registered_offset(curve, drifted, rod_m)
    known_s: list[float] = []
    known_rod: list[float] = []
    for segment in curve.segments:
        s = np.array([segment.start_m, segment.end_m])
        known_s += s.tolist()
        known_rod += _on_rod(s, segment, anchors, offset).tolist()
    # Stretches that overlap on the rod (a gap that shrank to nothing) must still run forward along it.
    ordered = np.maximum.accumulate(np.array(known_rod) + 1e-6 * np.arange(len(known_rod)))
    places = np.interp(rod_m, ordered, known_s)
    places += np.minimum(rod_m - ordered[0], 0.0) + np.maximum(rod_m - ordered[-1], 0.0)
    half = 0.5 * float(np.mean(np.diff(rod_m)))
    covered = np.zeros(len(rod_m), dtype=np.bool_)
    for low, high in zip(ordered[::2], ordered[1::2], strict=True):
        covered |= (rod_m >= low - half) & (rod_m <= high + half)
    return places, covered


def _tips(
    curve: FittedCurve, drifted: Float64Array, rod_m: Float64Array, seen: Observation, config: AnchoredConfig
) -> list[Anchor]:
    """The ends of the seen curve that are tips of the rod.

    Both ends are tips when the curve is as long as the rod; across a gap, where the path is uncertain, a coarser
    agreement is enough if nothing is known to hide a continuation of the ends. Otherwise an end is a tip when nothing
    hides its continuation and the registration puts it near a tip; of an unbroken curve that is too short, only the
    better end is.
    """
    length = float(rod_m[-1])
    start, end = curve.segments[0].start_m, curve.segments[-1].end_m
    first, last = Anchor(s_m=start, rod_m=0.0), Anchor(s_m=end, rod_m=length)
    misfit = abs(end - start - length) / length
    if misfit <= config.length_tolerance:
        return [first, last]
    onward = np.array([0.005, 0.01, 0.015])  # hidden within a node spacing
    cut_first = bool(np.any(shaded(curve.at(start - onward), seen)))
    cut_last = bool(np.any(shaded(curve.at(end + onward), seen)))
    broken = len(curve.segments) > 1
    if broken and not cut_first and not cut_last and misfit <= 3 * config.length_tolerance:
        return [first, last]
    offset = _registered_offset(curve, drifted, rod_m)
    off_first, off_last = abs(start + offset), abs(end + offset - length)
    is_first = not cut_first and off_first <= config.tip_snap_m
    is_last = not cut_last and off_last <= config.tip_snap_m
    if is_first and is_last and not broken:
        return [first] if off_first <= off_last else [last]
    return [first] * is_first + [last] * is_last


def _pin_anchors(curve: FittedCurve, rod_m: Float64Array, seen: Observation) -> list[Anchor]:
    """Anchors at the nodes that grippers hold, projected on the curve."""
    if not seen.pins:
        return []
    s, distance = project(np.array([pin.position_world for pin in seen.pins], dtype=np.float64), curve.points)
    near = 0.03  # a held rod passes through the tool centre point; a larger distance means another part of the curve
    return [
        Anchor(s_m=float(at), rod_m=float(rod_m[pin.node]))
        for pin, at, off in zip(seen.pins, s, distance, strict=True)
        if off < near
    ]


def _registered_offset(curve: FittedCurve, drifted: Float64Array, rod_m: Float64Array) -> float:
    """Rod coordinate minus curve coordinate by the registration: the median over its nodes [m]."""
    s, _ = project(drifted, curve.points)
    return float(np.median(rod_m - s))


def _on_rod(s: Float64Array, segment: Segment, anchors: list[Anchor], offset: float) -> Float64Array:
    """The rod coordinates of the two ends `s` of a seen stretch [m]."""
    slack = 0.01  # the fingers hide a pin, so that it is just outside the stretch
    inside = [a for a in anchors if segment.start_m - slack <= a.s_m <= segment.end_m + slack]
    if len(inside) >= 2:
        known_s = np.array([a.s_m for a in inside])
        known = np.array([a.rod_m for a in inside])
        past = np.minimum(s - known_s[0], 0.0) + np.maximum(s - known_s[-1], 0.0)
        return np.interp(s, known_s, known) + past
    if len(inside) == 1:
        return s + inside[0].rod_m - inside[0].s_m
    before = [a for a in anchors if a.s_m < segment.start_m][-1:]
    after = [a for a in anchors if a.s_m > segment.end_m][:1]
    offsets = [a.rod_m - a.s_m for a in before + after]
    return s + (float(np.mean(offsets)) if offsets else offset)


def _health(curve: FittedCurve, length_m: float, config: AnchoredConfig) -> float:
    """The fraction of the cloud on the curve, times how well the curve's length fits the rod (at most 1)."""
    fraction = float(np.mean(curve.used))
    excess = max(arc_span(curve) / length_m - 1.0 - config.length_tolerance, 0.0)
    return fraction * max(1.0 - 4.0 * excess, 0.0)


def arc_span(curve: FittedCurve) -> float:
    """Length of the curve from the first to the last seen place [m]."""
    return curve.segments[-1].end_m - curve.segments[0].start_m


def chain(count: int, length_m: float) -> Topology:
    """The topology of a plain rod: `count` nodes in a row, equally spaced."""
    return in_a_row(np.full(count - 1, length_m / (count - 1)))


def chain_lengths(nodes: Float64Array) -> Topology:
    """The topology of a plain rod at rest in the shape of its nodes (M, 3) [m]."""
    return in_a_row(np.diff(arc_lengths(nodes)))
