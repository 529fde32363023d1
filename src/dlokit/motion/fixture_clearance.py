"""Distances between the parts of an arm and fixtures, at postures and along a path of the hand. Pure.

Arm and fixtures are made of rounded boxes: all points within a radius of a box. The box of a capsule, and of a post, is
a line. A rounded box is a row of 16 numbers: its three axes (9, one after the other), centre (3) [m], half sizes (3)
[m] and radius (1) [m], so that compiled code takes arms and fixtures as plain arrays.

`mujoco.mj_geomDistance` gives the same distances. It takes 0.7 to 1.6 µs a pair, without the time to place the bodies
in a model that has to be compiled for each scene; `gap_m` takes 0.08 µs for lines, 0.14 for a line and a box, and 1.8
for two boxes, which are only a finger and a box.
"""

import itertools
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel, Capsule
from dlokit.description.scene import Fixture, Post
from dlokit.motion.forward_kinematics import link_transforms, tcp_matrices
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

FIXTURE_CLEARANCE_M = 0.004
"""Smallest distance of the arm from a fixture [m]: it is up to 2 mm off in x and in y (2.8 mm), the arm 0.5 mm; the
rest is reserve. Fixtures are also widened by `FIXTURE_TURN_RAD`, fingers by `FINGER_ERROR_M`."""
FINGER_ERROR_M = 0.001
"""Error of the position of each finger [m], by which fingers are widened."""
RESOLUTION_M = 0.0002
"""Differences of distances that do not matter [m]: the search between two postures ends there."""
FIXTURE_TURN_RAD = 0.0303
"""Error of a fixture's orientation, 1° about each axis: it is widened by what this turn moves its farthest point."""
_FAR_M = 0.1  # larger distances are not resolved: they are measured between the balls around two parts
_RELATIVE = 0.1  # nor are differences below this fraction of the distance
_SHORTEST = 1e-6  # fraction of a leg below which it is not halved
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # (8, 3), of a box in half sizes
_compiled = njit(cache=True, nogil=True, error_model="numpy")


def hand_clearance_m(
    arm: ArmModel, tool: ArrayLike, width_m: float, fixtures: tuple[Fixture, ...], enough_m: float = -np.inf
) -> float:
    """A lower bound [m] of the distance between the hand with its fingers and all fixtures along a path of the tool.

    The tool points down and moves in straight lines through `tool` (W, 4): x, y, z in the world [m] and yaw [rad]; one
    waypoint is a hand at rest. The fingertips are `width_m` apart [m]. The bound is lower than the distance by at most
    `RESOLUTION_M` and a tenth, and is not above 0.1 m; it is infinite without fixtures, and negative if they overlap.
    The search ends as soon as the bound is `enough_m` or less: the path may then be still nearer to a fixture.

    The bound between two places is that of `fixture_checks`. A path of five waypoints among six posts takes 0.1 ms.
    """
    if not fixtures:
        return float(np.inf)
    parts, levers_m = _hand_parts(arm, width_m)
    path = np.ascontiguousarray(np.asarray(tool, dtype=np.float64).reshape(-1, 4))
    return float(_least_along(path, parts, levers_m, fixture_solids(fixtures), enough_m))


@lru_cache(maxsize=64)
def fixture_solids(fixtures: tuple[Fixture, ...]) -> Float64Array:
    """The fixtures in the world (F, 16), each widened by the error of its orientation."""
    return np.array([_fixture_solid(fixture) for fixture in fixtures]).reshape(-1, 16)


def _fixture_solid(fixture: Fixture) -> Float64Array:
    foot_m = np.array(fixture.position_m)
    widened_m = FIXTURE_TURN_RAD * float(np.max(np.linalg.norm(fixture.corners_world - foot_m, axis=1)))
    if isinstance(fixture, Post):  # a line up to its height: a head that is flat is inside too
        radius_m, half = fixture.diameter_m / 2.0, np.array([0.0, 0.0, fixture.height_m / 2.0])
    else:
        radius_m, half = 0.0, np.array(fixture.size_m) / 2.0
    T = geometry.matrix(fixture.T_world_foot) @ geometry.homogeneous(np.eye(3), (0.0, 0.0, half[2]))
    return rounded_boxes(T, half, radius_m + widened_m)


def arm_solids(
    arm: ArmModel, q_rad: ArrayLike, finger_width_m: float | Float64Array, T_world_base: Pose | None = None
) -> Float64Array:
    """The parts of an arm in the world (K, P, 16), in the order of `part_links`, at joint angles (K, J) [rad].

    The fingertips are `finger_width_m` apart [m], one value or (K,).
    """
    links, T_link_part, half, radius = arm_parts(arm)
    T = link_transforms(arm, q_rad, finger_width_m, T_world_base)[:, links] @ T_link_part
    return rounded_boxes(T, half, radius)


def part_links(arm: ArmModel) -> tuple[str, ...]:
    """Link (P,) of each part: of its capsules, and of a box around each finger.

    The capsules alone leave out up to 8 mm of the pads and of the fingers' meshes; with the boxes it is 1.2 mm of the
    lower half of a Franka finger's mesh, and nothing of what collides in the cell.
    """
    return (*(capsule.link for capsule in arm.capsules), *FINGER_LINKS)


@lru_cache(maxsize=16)
def arm_parts(arm: ArmModel) -> tuple[list[int], Float64Array, Float64Array, Float64Array]:
    """Index of the link (P,), frame in it (P, 4, 4), half sizes (P, 3) and radius (P,) [m] of each part."""
    gripper, links = arm.gripper, part_links(arm)
    # Simulated fingers that move along an arc in reality are always as low as they can be.
    long_m = gripper.tcp_m + gripper.tip_below_tcp_m + gripper.largest_tip_drop_m - gripper.finger_m
    finger_half = np.array([gripper.pad_half_length_m, gripper.pushing_half_width_m / 2.0, long_m / 2.0])
    finger = geometry.homogeneous(np.eye(3), (0.0, *finger_half[1:]))
    lines = [_line(capsule) for capsule in arm.capsules]
    T = np.array([*(T for T, _ in lines), finger, finger])
    half = np.array([*((0.0, 0.0, half_m) for _, half_m in lines), finger_half, finger_half])
    errors = np.where(np.isin(links, FINGER_LINKS), FINGER_ERROR_M, 0.0)
    return [arm.links.index(link) for link in links], T, half, np.concatenate((arm.radii_m, [0.0, 0.0])) + errors


def _line(capsule: Capsule) -> tuple[Float64Array, float]:
    """The frame (4, 4) in the middle of a capsule, z along it, and half its length without the caps [m]."""
    start, end = np.array(capsule.start_m), np.array(capsule.end_m)
    # The decomposition's right factor has the direction of the line in its first row; the others complete it.
    axes = np.linalg.svd((end - start)[None, :])[2][::-1]
    return geometry.homogeneous(axes.T, (start + end) / 2.0), float(np.linalg.norm(end - start)) / 2.0


def rounded_boxes(T: Float64Array, half: Float64Array, radius: ArrayLike) -> Float64Array:
    """Rounded boxes (…, 16) with the frames (…, 4, 4), half sizes (…, 3) and radii (…) [m]."""
    rows = np.empty((*T.shape[:-2], 16))
    rows[..., :9] = np.swapaxes(T[..., :3, :3], -1, -2).reshape(*T.shape[:-2], 9)
    rows[..., 9:12], rows[..., 12:15], rows[..., 15] = T[..., :3, 3], half, radius
    return rows


def corner_distances(T: Float64Array, half: Float64Array, axes: int) -> Float64Array:
    """Largest distance (P,) [m] of a corner of boxes (P, …) from the origin of their reference frame, by x, y, (z)."""
    corners = np.einsum("pij,pcj->pci", T[:, :axes, :3], half[:, None] * _CORNERS) + T[:, None, :axes, 3]
    return np.sqrt(np.max(np.sum(corners**2, axis=-1), axis=-1))


@lru_cache(maxsize=64)
def _hand_parts(arm: ArmModel, width_m: float) -> tuple[Float64Array, Float64Array]:
    """Hand and fingers in the tool's frame (P, 16), and the largest distance (P,) of each from the tool's axis [m]."""
    links, T_link_part, half, radius = arm_parts(arm)
    of_hand = [number for number, link in enumerate(part_links(arm)) if link in (HAND, *FINGER_LINKS)]
    T_tcp_base = np.linalg.inv(tcp_matrices(arm, arm.home_q_rad)[0])
    T = (T_tcp_base @ link_transforms(arm, arm.home_q_rad, width_m)[0][links] @ T_link_part)[of_hand]
    return rounded_boxes(T, half[of_hand], radius[of_hand]), corner_distances(T, half[of_hand], axes=2)


@_compiled
def gaps_m(parts: Float64Array, fixtures: Float64Array) -> Float64Array:
    """Distances (K, P, F) [m] between parts (K, P, 16) and fixtures (F, 16), a lower bound where it is above 0.1 m."""
    gaps = np.empty((parts.shape[0], parts.shape[1], len(fixtures)))
    for k in range(parts.shape[0]):
        for part in range(parts.shape[1]):
            for fixture in range(len(fixtures)):
                gaps[k, part, fixture] = gap_m(parts[k, part], fixtures[fixture])
    return gaps


@_compiled
def gap_m(a: Float64Array, b: Float64Array) -> float:
    """Distance [m] between two rounded boxes (16,); negative, but not to scale, if they overlap.

    Where the balls around them are more than 0.1 m apart, it is the distance between the balls, a lower bound.
    """
    away, size_a, size_b = 0.0, 0.0, 0.0
    for i in range(3):
        away += (a[9 + i] - b[9 + i]) ** 2
        size_a += a[12 + i] ** 2
        size_b += b[12 + i] ** 2
    balls = np.sqrt(away) - np.sqrt(size_a) - np.sqrt(size_b) - a[15] - b[15]
    if balls > _FAR_M:
        return balls
    if a[12] == 0.0 and a[13] == 0.0:
        between = _edge_m(a, 2, 0.0, 0.0, b)
    elif b[12] == 0.0 and b[13] == 0.0:
        between = _edge_m(b, 2, 0.0, 0.0, a)
    else:  # where two boxes are nearest to each other, one of the two points is on an edge
        between = np.inf
        for axis in range(3):
            for first in (-1.0, 1.0):
                for second in (-1.0, 1.0):
                    edges = min(_edge_m(a, axis, first, second, b), _edge_m(b, axis, first, second, a))
                    between = min(between, edges)
    return between - a[15] - b[15]


@_compiled
def _edge_m(a: Float64Array, axis: int, first: float, second: float, b: Float64Array) -> float:
    """Distance of an edge of box `a` from box `b`: along an axis, at these ends (-1 or 1) of the two other axes.

    The slope of the squared distance along the edge rises, and is linear between the crossings of the faces' planes.
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    start, step = np.empty(3), np.empty(3)  # in the frame of b
    for k in range(3):
        start[k], step[k] = 0.0, 0.0
        for x in range(3):
            along = a[3 * axis + x] * a[12 + axis]
            across = first * a[3 * i + x] * a[12 + i] + second * a[3 * j + x] * a[12 + j]
            start[k] += b[3 * k + x] * (a[9 + x] - b[9 + x] - along + across)
            step[k] += 2.0 * b[3 * k + x] * along
    low, high = 0.0, 1.0
    at_low, at_high = _outside(start, step, b, low), _outside(start, step, b, high)
    if at_low[1] >= 0.0 or at_high[1] <= 0.0:
        return at_low[0] if at_low[1] >= 0.0 else at_high[0]
    for k in range(3):
        for side in (-1.0, 1.0):
            t = (side * b[12 + k] - start[k]) / step[k]
            if low < t < high:
                here = _outside(start, step, b, t)
                if here[1] < 0.0:
                    low, at_low = t, here
                else:
                    high, at_high = t, here
    return _outside(start, step, b, low + (high - low) * at_low[1] / (at_low[1] - at_high[1]))[0]


@_compiled
def _outside(start: Float64Array, step: Float64Array, b: Float64Array, t: float) -> tuple[float, float]:
    """Distance of ``start + t step`` (3,) from box `b`, in whose frame they are, and half the slope of its square."""
    squared, slope = 0.0, 0.0
    for k in range(3):
        here = start[k] + t * step[k]
        excess = here - max(-b[12 + k], min(b[12 + k], here))
        squared += excess**2
        slope += excess * step[k]
    return np.sqrt(squared), slope


@_compiled
def _place(part: Float64Array, tool: Float64Array, placed: Float64Array) -> None:
    """Write into `placed` (16,) a part (16,) in the frame of a tool (4,) that points down."""
    cosine, sine = np.cos(tool[3]), np.sin(tool[3])
    for row in range(4):  # three axes and the centre
        x, y, z = part[3 * row], part[3 * row + 1], part[3 * row + 2]
        placed[3 * row], placed[3 * row + 1], placed[3 * row + 2] = cosine * x + sine * y, sine * x - cosine * y, -z
    placed[9:12] += tool[:3]
    placed[12:] = part[12:]


@_compiled
def _least_along(
    path: Float64Array, parts: Float64Array, levers_m: Float64Array, fixtures: Float64Array, enough_m: float
) -> float:
    """The result of `hand_clearance_m` for a path (W, 4), parts (P, 16) with their levers (P,), fixtures (F, 16)."""
    placed = np.empty((len(path), len(parts), 16))
    for w in range(len(path)):
        for p in range(len(parts)):
            _place(parts[p], path[w], placed[w, p])
    at = gaps_m(placed, fixtures)
    bound = least = min(at.min(), _FAR_M)
    for w in range(len(path) - 1):
        step = path[w + 1] - path[w]
        travels = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) + levers_m * abs(step[3])
        for p in range(len(parts)):
            for f in range(len(fixtures)):
                if bound <= enough_m:
                    return bound
                span = (0.0, 1.0, at[w, p, f], at[w + 1, p, f])
                bound = min(bound, _leg_m(path[w], step, travels[p], span, parts[p], fixtures[f], least))
    return bound


@_compiled
def _leg_m(
    start: Float64Array,
    step: Float64Array,
    travel: float,
    span: tuple[float, float, float, float],
    part: Float64Array,
    fixture: Float64Array,
    least: float,
) -> float:
    """A lower bound [m] of the distance of a part from a fixture on a span of a leg: from, to, and the distances there.

    It is halved until its bound is near to `least`, a distance elsewhere, or to the distances at its ends, or above.
    """
    low, high, at_low, at_high = span
    bound, least = (at_low + at_high - travel * (high - low)) / 2.0, min(least, min(at_low, at_high))
    if not bound < least - RESOLUTION_M - _RELATIVE * max(least, 0.0) or high - low < _SHORTEST:
        return bound
    middle, placed = (low + high) / 2.0, np.empty(16)
    _place(part, start + middle * step, placed)
    here = gap_m(placed, fixture)
    first = _leg_m(start, step, travel, (low, middle, at_low, here), part, fixture, min(least, here))
    return min(first, _leg_m(start, step, travel, (middle, high, here, at_high), part, fixture, min(least, here)))
