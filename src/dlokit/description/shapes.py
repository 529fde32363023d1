"""Shapes of a DLO on the table: the built-in goals, and random starts.

All of them are planar curves given by their curvature along the arc, which falls to zero at both ends: a free
end carries no bending moment, so any other curve would need friction to bend its ends.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.clearance import clear_of
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import Fixture
from dlokit.errors import ShapeError
from dlokit.types.arrays import Float64Array

CENTRE_M = (0.52, 0.0)
"""Middle of the table, at which built-in shapes are centred [m]."""
RANDOM_X_M = (0.33, 0.72)
"""Range of random shapes along x [m]: away from the table's edge by more than one correction."""
RANDOM_Y_M = (-0.30, 0.30)
"""The same along y [m]."""

S_RADIUS_M = 0.08
"""Radius of the arcs of an S [m]; wide enough that friction holds it for the default rope."""
MIN_BEND_RADIUS_M = 0.06
"""Tightest bend of a random shape [m]."""
SELF_CLEARANCE_M = 0.05
"""Smallest distance of parts of a random shape that are not neighbours [m]: open fingers fit between."""
FIXTURE_CLEARANCE_M = 0.005
"""Smallest distance of a random shape's surface from a fixture [m]: one that is 2 mm and 1° off stays clear."""
NEIGHBOUR_M = 0.10
"""Parts nearer than this along the arc are neighbours [m]; at the tightest bend their chord is still 89 mm."""

CURVE_POINTS = 101
"""Number of points of starts and goals: finer than either rod, which resamples them."""
LENGTH_TOLERANCE = 0.02
"""Allowed relative difference between the lengths of a shape and the rod, for hand-drawn or measured curves. 2 % of
0.5 m moves the ends by 5 mm if everything else fits, less than half of the paper's threshold."""
RAMP_M = 0.025
"""Length over which the curvature of a bend rises from zero [m]: a jump would take a shear force that friction cannot
give."""

_FINE = 401  # points of the fine curve that shapes are resampled from
_HARMONICS = 4
_ATTEMPTS = 2000


def builtin_shape(name: str, length_m: float, count: int, *, radius_m: float = SOFT_ROPE.radius_m) -> Float64Array:
    """A built-in shape by its name, one of `BUILTIN_SHAPES`.

    Returns nodes (count, 3) [m] in the world frame, equally spaced by arc length, at z = `radius_m`, centred on
    `CENTRE_M`, from -y to +y. Raises `ShapeError` for an unknown name.
    """
    if name not in BUILTIN_SHAPES:
        raise ShapeError(
            f"There is no shape named {name!r}. Built in are {', '.join(BUILTIN_SHAPES)}; use one of these names."
        )
    return _on_table(BUILTIN_SHAPES[name](length_m), length_m, count, CENTRE_M, radius_m)


def from_curvature(
    curvature_1_m: ArrayLike, length_m: float, count: int, *, radius_m: float = SOFT_ROPE.radius_m
) -> Float64Array:
    """The planar curve of a curvature (K,) [1/m], at equal steps of the arc; nodes as `builtin_shape` has them."""
    return _on_table(np.asarray(curvature_1_m, dtype=np.float64), length_m, count, CENTRE_M, radius_m)


def random_shape(
    rng: np.random.Generator,
    length_m: float,
    count: int,
    *,
    radius_m: float = SOFT_ROPE.radius_m,
    min_bend_radius_m: float = MIN_BEND_RADIUS_M,
    fixtures: Sequence[Fixture] = (),
) -> Float64Array:
    """A smooth random curve on the table, drawn from `rng` alone.

    The curvature is a sine series of four terms over the arc, with normal amplitudes that fall as 1 / k, scaled so
    that its peak is uniform between 0 and 1 / `min_bend_radius_m`. The heading is uniform, and the position is
    uniform within `RANDOM_X_M` × `RANDOM_Y_M`. Curves that do not fit in this area, or come nearer than
    `SELF_CLEARANCE_M` to themselves or than `FIXTURE_CLEARANCE_M` to a fixture, are drawn again.

    Returns nodes (count, 3) [m] in the world frame at z = `radius_m`. Raises `ShapeError` when the rope is too long
    for the table.
    """
    lower = np.array([RANDOM_X_M[0], RANDOM_Y_M[0]])
    upper = np.array([RANDOM_X_M[1], RANDOM_Y_M[1]])
    for _ in range(_ATTEMPTS):
        curve = _random_curve(rng, length_m, 1.0 / min_bend_radius_m)  # (_FINE, 2)
        slack = (upper - lower) - (curve.max(axis=0) - curve.min(axis=0))
        if np.any(slack < 0.0) or self_clearance_m(curve) < SELF_CLEARANCE_M:
            continue
        corner = lower + rng.uniform(size=2) * slack
        placed = curve - curve.min(axis=0) + corner
        nodes = _lift(geometry.resample(placed, count), radius_m)
        if clear_of(nodes, fixtures, radius_m + FIXTURE_CLEARANCE_M):
            return nodes
    among = f" among the {len(fixtures)} fixtures" if fixtures else ""
    raise ShapeError(
        f"No random shape of {length_m:.2f} m fits the table{among}: it must lie within x {RANDOM_X_M[0]} to "
        f"{RANDOM_X_M[1]} m and y {RANDOM_Y_M[0]} to {RANDOM_Y_M[1]} m without coming nearer than "
        f"{SELF_CLEARANCE_M * 100:.0f} cm to itself. Use a shorter rope, or give the start as a file."
    )


def moved(nodes_world: ArrayLike, offset_m: ArrayLike, yaw_rad: float = 0.0) -> Float64Array:
    """A shape turned by `yaw_rad` about the vertical through its middle, then moved by `offset_m` (2,) [m].

    `nodes_world` (K, 3) [m]; the middle is the mean of the nodes. Returns (K, 3).
    """
    nodes = np.array(nodes_world, dtype=np.float64)
    middle = nodes[:, :2].mean(axis=0)
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    turned = (nodes[:, :2] - middle) @ np.array([[cosine, sine], [-sine, cosine]])
    nodes[:, :2] = middle + turned + np.asarray(offset_m, dtype=np.float64)
    return nodes


def fit_length(nodes_world: ArrayLike, length_m: float) -> Float64Array:
    """A shape (K, 3) [m] scaled about the mean of its nodes, so that its arc is `length_m` long."""
    nodes = np.asarray(nodes_world, dtype=np.float64)
    middle = nodes.mean(axis=0)
    return middle + (nodes - middle) * (length_m / length(nodes))


def length(nodes_world: ArrayLike) -> float:
    """Length of a polyline (K, d) along its arc [m]."""
    return float(geometry.arc_lengths(nodes_world)[-1])


def self_clearance_m(nodes_world: ArrayLike) -> float:
    """Smallest distance [m] between two nodes of (K, d) [m] that are further apart than `NEIGHBOUR_M` on the arc.

    Infinite when the curve is shorter than that.
    """
    nodes = np.asarray(nodes_world, dtype=np.float64)
    s = geometry.arc_lengths(nodes)
    apart = np.abs(s[:, None] - s[None, :]) > NEIGHBOUR_M
    distance = np.linalg.norm(nodes[:, None, :] - nodes[None, :, :], axis=2)
    return float(distance[apart].min(initial=np.inf))


def _straight(length_m: float) -> Float64Array:
    """The curvature (_FINE,) [1/m] of an I."""
    return np.zeros(_FINE)


def _two_arcs(length_m: float) -> Float64Array:
    """The curvature (_FINE,) [1/m] of an S: two equal, opposite arcs.

    Their radius is `S_RADIUS_M`, or more where a long rope would turn by over half a circle. At the ends and in
    the middle the curvature changes linearly: a jump would take a shear force that friction cannot give.
    """
    ramp_m = min(RAMP_M, length_m / 8.0)
    radius_m = max(S_RADIUS_M, (length_m / 2.0 - ramp_m) / np.pi)
    corners = np.array([0.0, ramp_m, length_m / 2 - ramp_m, length_m / 2 + ramp_m, length_m - ramp_m, length_m])
    values = np.array([0.0, 1.0, 1.0, -1.0, -1.0, 0.0]) / radius_m
    return np.interp(np.linspace(0.0, length_m, _FINE), corners, values)


def _bends(turns_rad: tuple[float, ...], radius_m: float) -> Callable[[float], Float64Array]:
    """Curvatures of bends of `radius_m` at equal distances, straight between them; positive turns to the left.

    A rope that is too short for them bends more tightly.
    """

    def curvature(length_m: float) -> Float64Array:
        ramp_m = min(RAMP_M, length_m / 8.0)
        bend_m = min(radius_m, (length_m - ramp_m) / sum(map(abs, turns_rad)))
        widths_m = [abs(turn) * bend_m for turn in turns_rad]
        gap_m = (length_m - ramp_m - sum(widths_m)) / (len(turns_rad) + 1)
        s = np.linspace(0.0, length_m, _FINE)
        total, at_m = np.zeros(_FINE), ramp_m / 2.0 + gap_m
        for turn, width_m in zip(turns_rad, widths_m, strict=True):
            # Rises and falls within `ramp_m` around both ends, so that its area stays the turn.
            inside = np.minimum((s - at_m) / ramp_m, (at_m + width_m - s) / ramp_m) + 0.5
            total += np.sign(turn) / bend_m * np.clip(inside, 0.0, 1.0)
            at_m += width_m + gap_m
        return total

    return curvature


def _spiral(length_m: float) -> Float64Array:
    """The curvature (_FINE,) [1/m] of a spiral that is wound by 307°, more tightly towards its last end."""
    share = np.linspace(0.0, 1.0, _FINE)
    outer, inner = 1.0 / (SPIRAL_RADII[0] * length_m), 1.0 / (SPIRAL_RADII[1] * length_m)
    ramp = min(RAMP_M, length_m / 8.0) / length_m
    return (outer + (inner - outer) * share) * np.clip(np.minimum(share, 1.0 - share) / ramp, 0.0, 1.0)


SPIRAL_RADII = (0.28, 0.13)
"""Radius of the spiral at its first and its last end, over the length of the rope."""
_U_RADIUS_M, _W_RADIUS_M, _W_TURN_RAD = 0.085, 0.065, np.radians(120.0)

BUILTIN_SHAPES: Mapping[str, Callable[[float], Float64Array]] = {
    "I": _straight,
    "L": _bends((np.pi / 2.0,), S_RADIUS_M),
    "U": _bends((np.pi,), _U_RADIUS_M),
    "S": _two_arcs,
    "W": _bends((_W_TURN_RAD, -_W_TURN_RAD, _W_TURN_RAD), _W_RADIUS_M),
    "spiral": _spiral,
}
"""Built-in shapes: name → curvature (_FINE,) [1/m] along an arc of the given length [m]."""


def _random_curve(rng: np.random.Generator, length_m: float, peak_limit: float) -> Float64Array:
    """A random curve (_FINE, 2) [m], anywhere, of random heading and of a curvature up to `peak_limit` [1/m]."""
    order = np.arange(1, _HARMONICS + 1)
    amplitudes = rng.normal(size=_HARMONICS) / order
    series = np.sin(np.pi * np.linspace(0.0, 1.0, _FINE)[:, None] * order) @ amplitudes
    curvature = series / np.abs(series).max() * rng.uniform(0.0, peak_limit)
    curve = _integrate(curvature, length_m)
    heading = rng.uniform(-np.pi, np.pi)
    cosine, sine = np.cos(heading), np.sin(heading)
    return curve @ np.array([[cosine, sine], [-sine, cosine]])


def _integrate(curvature: Float64Array, length_m: float) -> Float64Array:
    """The planar curve (K, 2) [m] of a curvature (K,) [1/m], by the trapezoidal rule, from the origin along x."""
    step = length_m / (len(curvature) - 1)
    heading = np.concatenate(([0.0], np.cumsum((curvature[1:] + curvature[:-1]) / 2.0) * step))
    middle = (heading[1:] + heading[:-1]) / 2.0
    steps = step * np.column_stack([np.cos(middle), np.sin(middle)])
    return np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


def _on_table(
    curvature: Float64Array, length_m: float, count: int, centre_m: tuple[float, float], radius_m: float
) -> Float64Array:
    """The curve of a curvature as nodes (count, 3), the line from its first to its last end along +y."""
    curve = _integrate(curvature, length_m)
    chord = curve[-1] - curve[0]
    along, across = chord / np.linalg.norm(chord), np.array([chord[1], -chord[0]]) / np.linalg.norm(chord)
    turned = np.column_stack([curve @ across, curve @ along])
    middle = (turned.max(axis=0) + turned.min(axis=0)) / 2.0
    return _lift(geometry.resample(turned - middle + np.array(centre_m), count), radius_m)


def _lift(points_xy: Float64Array, height_m: float) -> Float64Array:
    """Points (K, 2) [m] of the table plane as (K, 3) at a height."""
    return np.column_stack([points_xy, np.full(len(points_xy), height_m)])
