"""Checks of start and goal shapes: named findings with the cause and the place."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import TIP_CLEARANCE_M, ArmModel
from dlokit.description.clearance import distances_m
from dlokit.description.scene import NO_FIXTURES, Fixture, Scene
from dlokit.description.shapes import LENGTH_TOLERANCE
from dlokit.geometry.camera import project
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.base import Reachable
from dlokit.skills.planning.grasp import fitting_opening_m, grasp_pose, grasp_yaw, rod_point
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.feasibility import Finding, Problem, Verdict
from dlokit.types.image import CameraCalibration

Crossing = tuple[int, int]
"""Two edges that cross, by their first nodes, the lower first."""


def untangling_rmse_m(nodes_world: Float64Array, crossings: list[Crossing], radius_m: float) -> float:
    """Approximate smallest RMSE [m] between a rod (M, 3) [m] and a shape that does not cross itself.

    Two strands that cross once are separated by drawing the tail back over the other strand, or that strand over the
    tail's end; two that cross twice by pushing the part between back. Either may move half of the distance. The most
    expensive crossing counts, or what it takes to lay strands that only touch beside each other.
    """
    points, width_m = nodes_world[:, :2], 2.0 * radius_m
    squares = [
        min(_tail(points, pair, width_m), *(_between(points, pair, other, width_m) for other in crossings))
        for pair in crossings
    ]
    return float(np.sqrt(max([_touching(nodes_world, radius_m), *squares]) / 2.0 / len(points)))


def _tail(points: Float64Array, crossing: Crossing, width_m: float) -> float:
    """Sum of squares [m²] of the shorter tail's distances to the other side of the strand that it crosses."""
    first, second = crossing
    middle = (first + second) // 2 + 1
    tails = (points[: first + 1], points[middle:]), (points[second + 1 :], points[:middle])
    return min(_sum(*tail, width_m) for tail in tails)


def _between(points: Float64Array, one: Crossing, other: Crossing, width_m: float) -> float:
    """The same for the part between two crossings of the same two strands; infinite if there is only one crossing.

    Two crossings of the same edge are no such pair: there is no node between them that could be pushed back.
    """
    (a, c), (b, d) = sorted((one, other))
    if a == b or c == d or b >= min(c, d):
        return np.inf
    low, high = min(c, d), max(c, d)
    parts = (points[a + 1 : b + 1], points[low : high + 2]), (points[low + 1 : high + 1], points[a : b + 2])
    return min(_sum(*part, width_m) for part in parts)


def _sum(moved: Float64Array, strand: Float64Array, width_m: float) -> float:
    """Sum of squares [m²] of the distances by which points (K, 2) [m] must move past a strand (L, 2) [m]."""
    distances = np.linalg.norm(moved[:, None] - strand[None], axis=2).min(axis=1)
    return float(((distances + width_m) ** 2).sum())


def _touching(nodes_world: Float64Array, radius_m: float) -> float:
    """Sum of squares [m²] of the overlap of two touching strands, over the nodes of one of them."""
    pairs, apart_m, count = _touches(nodes_world, radius_m)
    lacking_m = np.zeros(count)
    np.maximum.at(lacking_m, pairs, (2.0 * radius_m - apart_m)[:, None])
    return float((lacking_m**2).mean() * len(nodes_world) / 2.0)  # both strands overlap


def _touches(nodes_world: Float64Array, radius_m: float) -> tuple[Int64Array, Float64Array, int]:
    """Pairs (K, 2) of points of two strands nearer than the diameter, the distances (K,) [m], and how many points.

    The points are at equal distances along the rod (M, 3) [m], a small part of the radius.
    """
    length_m = float(geometry.arc_lengths(nodes_world[:, :2])[-1])
    count = int(_FINER * length_m / radius_m) + 2
    points = geometry.resample(nodes_world[:, :2], count)
    pairs = KDTree(points).query_pairs(2.0 * radius_m, output_type="ndarray")
    pairs = pairs[np.diff(pairs)[:, 0] * length_m > _ONE_STRAND * radius_m * (count - 1)]
    return pairs, np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1), count


VIEW_MARGIN_PX = 4.0
"""A node must be this far inside the picture [px]."""
HANDLED_FROM_M = 0.05
"""A goal node that cannot be grasped is accepted when a node within this arc length can be grasped [m]."""

MOST_OVERLAP_M = 0.003
"""Overlap of a goal and a fixture that touch one another [m]: a goal that was shown to the camera is off by as much."""
_STEP_M = 0.001  # between the points at which a shape is compared with a fixture

_FINER = 4  # points per radius for distances between strands
_ONE_STRAND = 10.0  # radii along the rod between two strands: nearer parts meet in a sharp bend, which has its own name


@dataclass(frozen=True)
class Workplace:
    """The limits of a shape, and the functions that check them."""

    dlo: BelievedDlo
    config: FeasibilityConfig
    reachable: Reachable
    calibration: CameraCalibration | None
    """None: views are not checked."""
    arm: ArmModel = PANDA
    """The arm that moves the tool, and its gripper."""
    place_m: tuple[float, float] = (0.0, 0.0)
    """Position of its base (x, y) [m]."""
    tip_clearance_m: float = TIP_CLEARANCE_M
    """Distance of the fingertips from the table at grasp and release [m]."""
    scene: Scene = NO_FIXTURES
    """The believed fixtures."""

    @property
    def grasp_height_m(self) -> float:
        """Height of the tool centre point over the table at grasp and release [m]."""
        return self.arm.gripper.grasp_height_m(self.tip_clearance_m)


def check_start(nodes_world: Float64Array, place: Workplace) -> Verdict:
    """Findings about a rod at `nodes_world` (M, 3) [m] that prevent any shaping."""
    found = _on_table(nodes_world, place.config), _in_reach(nodes_world, place, handled_from_m=0.0)
    seen = _in_view(nodes_world, place.calibration)
    return Verdict(findings=_those(*found, seen, _crossing(nodes_world)))


def out_of_bounds(nodes_world: Float64Array, place: Workplace) -> tuple[Finding, ...]:
    """The limits that a goal (M, 3) [m] violates and that a translation may satisfy: table, reach, view."""
    return _those(
        _on_table(nodes_world, place.config),
        _in_reach(nodes_world, place, handled_from_m=HANDLED_FROM_M),
        _in_view(nodes_world, place.calibration),
    )


def is_within_bounds(nodes_world: Float64Array, place: Workplace) -> bool:
    """Whether `out_of_bounds` finds nothing for (K, 3) [m]; stops at the first finding, cheap checks first."""
    return not (
        _on_table(nodes_world, place.config)
        or _in_view(nodes_world, place.calibration)
        or _in_reach(nodes_world, place, handled_from_m=HANDLED_FROM_M)
    )


def overlaps(nodes_world: Float64Array, radius_m: float) -> tuple[Finding, ...]:
    """Findings where a rod (M, 3) [m] of `radius_m` crosses or touches itself."""
    crossing = _crossing(nodes_world)
    return _those(crossing if crossing is not None else _touches_itself(nodes_world, radius_m))


def overlaps_fixtures(nodes_world: Float64Array, place: Workplace) -> tuple[Finding, ...]:
    """Findings where a goal (M, 3) [m] overlaps fixtures, one for each."""
    return _those(*(_overlaps_fixture(nodes_world, fixture, place.dlo.radius_m) for fixture in place.scene.fixtures))


def _overlaps_fixture(nodes_world: Float64Array, fixture: Fixture, radius_m: float) -> Finding | None:
    count = 2 + int(geometry.arc_lengths(nodes_world)[-1] / _STEP_M)
    points = geometry.resample(nodes_world, count)
    surface_m = distances_m(points, fixture) - radius_m  # of the DLO from the fixture's
    nearest = int(surface_m.argmin())
    overlap_m = -float(surface_m[nearest])
    if overlap_m <= MOST_OVERLAP_M:
        return None
    x, y = points[nearest, :2]
    node = round(nearest * (len(nodes_world) - 1) / (count - 1))
    text = (
        f"The shape overlaps the {fixture.kind} {fixture.name} by {1e3 * overlap_m:.1f} mm at ({x:.3f}, {y:.3f}) m, "
        f"beside node {node}; {1e3 * MOST_OVERLAP_M:.1f} mm are allowed. Lead it past the {fixture.kind}, or correct "
        "the fixture's position_m."
    )
    return length_finding(Problem.OVERLAPS_FIXTURE, node, overlap_m, MOST_OVERLAP_M, text)


def bends(nodes_world: Float64Array, config: FeasibilityConfig) -> tuple[Finding, ...]:
    """Findings where a goal (M, 3) [m] bends more tightly than allowed."""
    edges = np.diff(nodes_world[:, :2], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.abs((np.diff(headings) + np.pi) % (2.0 * np.pi) - np.pi)  # (M - 2,) [rad]
    radii = (lengths[:-1] + lengths[1:]) / 2.0 / np.maximum(turns, 1e-9)
    node = int(radii.argmin()) + 1
    if radii[node - 1] >= config.min_bend_radius_m:
        return ()
    text = (
        f"The shape bends too tightly: the radius is {radii[node - 1]:.3f} m at {place_of(nodes_world, node)}; "
        f"at least {config.min_bend_radius_m:.3f} m is allowed. Use a smoother shape."
    )
    tightest_m = float(radii[node - 1])
    return (length_finding(Problem.BENDS_TOO_TIGHTLY, node, tightest_m, config.min_bend_radius_m, text),)


def misfits(nodes_world: Float64Array, length_m: float) -> tuple[Finding, ...]:
    """Finding if a goal (M, 3) [m] is longer or shorter than a rod of `length_m`."""
    excess_m = float(geometry.arc_lengths(nodes_world)[-1]) - length_m
    allowed_m = LENGTH_TOLERANCE * length_m
    if abs(excess_m) <= allowed_m:
        return ()
    text = (
        f"The shape is {abs(excess_m):.3f} m {'longer' if excess_m > 0.0 else 'shorter'} than the rod's "
        f"{length_m:.3f} m; {allowed_m:.3f} m is allowed. Give a curve of the rod's length."
    )
    return (length_finding(Problem.WRONG_LENGTH, len(nodes_world) - 1, abs(excess_m), allowed_m, text),)


def crowded(nodes_world: Float64Array, place: Workplace) -> tuple[Finding, ...]:
    """Findings where a rod (M, 3) [m] is too close to itself for the fingers."""
    fits = [
        fitting_opening_m(place.arm.gripper, nodes_world, rod_point(nodes_world, fraction), place.dlo.radius_m)
        is not None
        for fraction in np.linspace(0.0, 1.0, len(nodes_world))
    ]
    node, gap_m = _farthest_from(nodes_world, np.array(fits))
    if gap_m <= HANDLED_FROM_M:
        return ()
    text = (
        f"There is no room for the fingers: from {place_of(nodes_world, node)} it is {gap_m:.3f} m along the "
        f"rod to where they fit; {HANDLED_FROM_M:.2f} m is allowed. Leave more room between strands."
    )
    return (length_finding(Problem.NO_ROOM_FOR_FINGERS, node, gap_m, HANDLED_FROM_M, text),)


def length_finding(problem: Problem, node: int, amount_m: float, limit_m: float, text: str) -> Finding:
    """A finding whose amount and limit are lengths [m]."""
    return Finding(problem=problem, node=node, amount=amount_m, limit=limit_m, unit="m", text=text)


def _those(*findings: Finding | None) -> tuple[Finding, ...]:
    return tuple(finding for finding in findings if finding is not None)


def _farthest_from(nodes_world: Float64Array, good: BoolArray) -> tuple[int, float]:
    """The node farthest along the rod from any `good` one (M,), and how far [m]; the rod's length when none is."""
    s = geometry.arc_lengths(nodes_world)
    if not good.any():
        return 0, float(s[-1])
    gaps = np.abs(s[:, None] - s[good][None, :]).min(axis=1)
    node = int(gaps.argmax())
    return node, float(gaps[node])


def place_of(nodes_world: Float64Array, node: int) -> str:
    """A node of (M, 3) [m] and its position, as text."""
    x, y = nodes_world[node, :2]
    return f"node {node} at ({x:.3f}, {y:.3f}) m"


def _on_table(nodes_world: Float64Array, config: FeasibilityConfig) -> Finding | None:
    (x0, x1), (y0, y1) = config.table_x_m, config.table_y_m
    lower, upper = np.array([x0, y0]), np.array([x1, y1])
    outside = np.maximum(lower - nodes_world[:, :2], nodes_world[:, :2] - upper).max(axis=1)  # (M,) [m]
    node = int(outside.argmax())
    if outside[node] <= 0.0:
        return None
    text = (
        f"The shape is off the table: {place_of(nodes_world, node)} is {outside[node]:.3f} m outside; allowed "
        f"is x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to {y1:.2f} m. Move the shape."
    )
    return length_finding(Problem.OFF_TABLE, node, float(outside[node]), 0.0, text)


def _in_reach(nodes_world: Float64Array, place: Workplace, *, handled_from_m: float) -> Finding | None:
    """A node out of reach is accepted when a node within the arc length `handled_from_m` can be grasped."""
    last = len(nodes_world) - 1
    reached = np.array([_can_grasp(nodes_world, node / last, place) for node in range(last + 1)])
    node, gap_m = _farthest_from(nodes_world, reached)
    if gap_m <= handled_from_m:
        return None
    yaw_deg = np.degrees(rod_point(nodes_world, node / last).yaw_rad)
    text = (
        f"The shape is out of the arm's reach: it cannot grasp {place_of(nodes_world, node)}, across a rod "
        f"that points to {yaw_deg:.0f}°. Move the shape towards (0.52, 0) m."
    )
    return length_finding(Problem.OUT_OF_REACH, node, gap_m, handled_from_m, text)


def _can_grasp(nodes_world: Float64Array, fraction: float, place: Workplace) -> bool:
    point = rod_point(nodes_world, fraction)
    yaw = grasp_yaw(place.arm, point, 0.0, place.place_m)
    # The gripper may have either of two yaws; one within the arm's reach is enough.
    return any(place.reachable(grasp_pose(point, yaw + turn, place.grasp_height_m)) for turn in (0.0, np.pi, -np.pi))


def _in_view(nodes_world: Float64Array, calibration: CameraCalibration | None) -> Finding | None:
    if calibration is None:
        return None
    projection = project(nodes_world, calibration)
    u, v = projection.pixels.T
    width, height = calibration.width_px, calibration.height_px
    outside_px = np.max([-u, u - (width - 1), -v, v - (height - 1)], axis=0) + VIEW_MARGIN_PX
    outside_px[projection.depth_m <= 0.0] = np.inf
    node = int(outside_px.argmax())
    if outside_px[node] <= 0.0:
        return None
    return Finding(
        problem=Problem.OUT_OF_VIEW,
        node=node,
        amount=min(float(outside_px[node]), float(width)),
        limit=0.0,
        unit="px",
        text=f"The shape is out of the camera's view: {place_of(nodes_world, node)} projects to pixel "
        f"({u[node]:.0f}, {v[node]:.0f}); the picture is {width} x {height} with a margin of "
        f"{VIEW_MARGIN_PX:.0f}. Move the shape or the camera.",
    )


def _touches_itself(nodes_world: Float64Array, radius_m: float) -> Finding | None:
    pairs, apart_m, count = _touches(nodes_world, radius_m)
    if not len(pairs):
        return None
    nearest = int(apart_m.argmin())
    clearance_m = float(apart_m[nearest])
    node, other = (pairs[nearest] * (len(nodes_world) - 1) / (count - 1)).round().astype(int).tolist()
    text = (
        f"The DLO lies upon itself: {place_of(nodes_world, node)} is {clearance_m:.3f} m from the strand at node "
        f"{other}; at least its diameter, {2.0 * radius_m:.3f} m, is needed. Lay it open."
    )
    return length_finding(Problem.LIES_ON_ITSELF, node, clearance_m, 2.0 * radius_m, text)


def _crossing(nodes_world: Float64Array) -> Finding | None:
    for first, second in crossings(nodes_world[:, :2]):
        text = (
            f"The DLO lies across itself: between {place_of(nodes_world, first)} and the next it crosses "
            f"the part after node {second}. Only shapes that do not cross themselves are allowed; lay it open."
        )
        return length_finding(Problem.CROSSES_ITSELF, first, 0.0, 0.0, text)
    return None


def crossings(nodes: Float64Array) -> Iterator[Crossing]:
    """Pairs of edges (M, 2) that cross, by their first nodes; neighbouring edges only touch and do not count."""
    start, along = nodes[:-1], np.diff(nodes, axis=0)
    for first in range(len(start) - 2):
        later = slice(first + 2, None)
        offset = start[later] - start[first]
        area = _cross(along[first], along[later])
        with np.errstate(divide="ignore", invalid="ignore"):
            here = _cross(offset, along[later]) / area
            there = _cross(offset, along[first]) / area
        hits = np.flatnonzero((here > 0.0) & (here < 1.0) & (there > 0.0) & (there < 1.0))
        for hit in hits:
            yield first, first + 2 + int(hit)


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
