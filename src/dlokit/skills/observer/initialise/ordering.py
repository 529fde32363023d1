"""Orders pieces of line along one rod: the path with the least bending, the smallest gaps, and the rod's length.

At a self-crossing a rod continues straight; where it is not seen it keeps its direction. The cost of a path through
the pieces is the bending energy and the unsupported length of each link, plus the omitted length and the difference
from the rod's length. A depth-first search with a bound finds the cheapest path.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from dlokit.geometry import arc_lengths
from dlokit.types.arrays import Float64Array

# Costs of an order of pieces, in the unit of bending energy, ∫ κ² ds [1/m].
_TANGENT_M = 0.02
"""Length of the last stretch that gives the direction of an end [m]."""
_BEND_M = 0.04
"""Length of the last stretch that gives the curvature of an end [m]."""
_INERTIA = 0.7
"""Weight of curvature continuity across a link: 0 penalises its bend, 1 its change of curvature."""
_SUPPORT_M = 0.006
"""A point of a link counts as seen with a cloud point this near [m]."""
_UNSEEN_PER_M = 300.0
"""Cost of each unseen metre of a link [1/m²]."""
_OMITTED_PER_M = 1200.0
"""Cost of each metre of pieces outside the path [1/m²]."""
_LENGTH_COST = 16.0
"""Cost of a length that is off by `_LENGTH_SIGMA`; it grows with the square [1/m]."""
_LENGTH_SIGMA = 0.03
"""Relative standard deviation of the length of a path."""
_LARGEST_TURN_RAD = 2.1
"""A link may turn by at most this at one of its ends [rad]."""
_FACING_M = 0.025
"""Two tips that point at each other within this distance may be part of a closed ring [m]."""
_MOST_STEPS = 20_000
"""Steps after which the search ends with the best path so far."""


@dataclass(frozen=True, kw_only=True)
class Route:
    """A path through the pieces in one order."""

    cost: float
    ends: tuple[int, ...]
    """Ends at which pieces are entered, in order; end 2 i is the first point of piece i, 2 i + 1 its last."""
    length_m: float

    @property
    def pieces(self) -> tuple[int, ...]:
        """The pieces in order."""
        return tuple(end // 2 for end in self.ends)


@dataclass(frozen=True, kw_only=True)
class Links:
    """All links from end to end; E = 2 x number of pieces."""

    cost: Float64Array
    """(E, E), infinite where no link is allowed."""
    length_m: Float64Array
    """(E, E)."""
    points: Float64Array
    """(E, E, S, 3) [m] places along it."""


LINK_STEPS = 13


def links(pieces: list[Float64Array], support: Float64Array, longest_gap_m: float) -> Links:
    """The links between the ends of pieces (K_i, 3) [m], supported by points (N, 3) [m].

    The bending energy is that of the cubic between the middles of the two last stretches with their directions,
    4 / c (α² + α β + β²) with the angles α and β from the chord c [m].
    """
    inner, outward, ends, bend = _ends(pieces)
    count = len(ends)
    a, b = np.nonzero(np.arange(count)[:, None] // 2 != np.arange(count)[None, :] // 2)
    chord = inner[b] - inner[a]
    span = np.maximum(np.linalg.norm(chord, axis=1), 1e-6)
    chord = chord / span[:, None]
    leaving, arriving = _turn(chord, outward[a]), _turn(chord, -outward[b])
    goes_on = 0.25 * (bend[a] + bend[b]) * span[:, None]
    goes_on -= _dot(goes_on, chord)[:, None] * chord
    energy = (1 - _INERTIA) * _energy(leaving, arriving, span)
    energy += _INERTIA * _energy(leaving + goes_on, arriving - goes_on, span)
    curves = hermite(ends[a], outward[a], ends[b], -outward[b])
    steps = np.linalg.norm(np.diff(curves, axis=1), axis=2)
    length = steps.sum(axis=1)
    middles = 0.5 * (curves[:, 1:] + curves[:, :-1])
    seen = scipy.spatial.KDTree(support).query(middles.reshape(-1, 3), distance_upper_bound=_SUPPORT_M)[0]
    unseen = np.sum(steps * ~np.isfinite(seen).reshape(steps.shape), axis=1)
    sharpest = np.maximum(np.linalg.norm(leaving, axis=1), np.linalg.norm(arriving, axis=1))
    allowed = (unseen <= longest_gap_m) & (length < 2.0 * longest_gap_m) & (sharpest < _LARGEST_TURN_RAD)
    result = Links(
        cost=np.full((count, count), np.inf),
        length_m=np.zeros((count, count)),
        points=np.zeros((count, count, LINK_STEPS, 3)),
    )
    result.cost[a, b] = np.where(allowed, energy + _UNSEEN_PER_M * unseen, np.inf)
    result.length_m[a, b] = length
    result.points[a, b] = curves
    return result


def _energy(leaving: Float64Array, arriving: Float64Array, span_m: Float64Array) -> Float64Array:
    return 4.0 / span_m * (_dot(leaving, leaving) + _dot(leaving, arriving) + _dot(arriving, arriving))


def _dot(a: Float64Array, b: Float64Array) -> Float64Array:
    return np.sum(a * b, axis=1)


def _turn(chord: Float64Array, direction: Float64Array) -> Float64Array:
    """The angle from chords (n, 3) to directions (n, 3), as a vector across the chord (n, 3) [rad]."""
    along = _dot(chord, direction)
    across = direction - along[:, None] * chord
    size = np.linalg.norm(across, axis=1)
    return across * (np.arctan2(size, along) / np.maximum(size, 1e-9))[:, None]


def _ends(
    pieces: list[Float64Array],
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """For each end the middle of its last stretch, the direction outward there, its last point, the curvature [1/m].

    All (E, 3).
    """
    inner, outward, last, bend = [], [], [], []
    for piece in pieces:
        for line in (piece, piece[::-1]):
            s = arc_lengths(line)
            part = line[: max(int(np.searchsorted(s, _TANGENT_M, side="right")), 2)]
            middle = part.mean(axis=0)
            axis = np.linalg.svd(part - middle)[2][0]
            inner.append(middle)
            outward.append(axis if axis @ (part[0] - part[-1]) > 0 else -axis)
            last.append(line[0])
            count = int(np.searchsorted(s, _BEND_M, side="right"))
            if s[count - 1] < 0.5 * _BEND_M:
                bend.append(np.zeros(3))
            else:
                c = np.polynomial.polynomial.polyfit(s[:count], line[:count], 2)
                bend.append(2.0 * c[2])
    return np.array(inner), np.array(outward), np.array(last), np.array(bend)


def hermite(start: Float64Array, leaving: Float64Array, end: Float64Array, arriving: Float64Array) -> Float64Array:
    """Places (n, S, 3) along the cubics from `start` to `end` with unit tangents there, all (n, 3)."""
    span = np.linalg.norm(end - start, axis=1)[:, None, None]
    t = np.linspace(0.0, 1.0, LINK_STEPS)[None, :, None]
    p, q = start[:, None], end[:, None]
    u, v = span * leaving[:, None], span * arriving[:, None]
    return (2 * t**3 - 3 * t**2 + 1) * p + (t**3 - 2 * t**2 + t) * u + (3 * t**2 - 2 * t**3) * q + (t**3 - t**2) * v


def routes(pieces: list[Float64Array], joined: Links, length_m: float | None, margin: float) -> list[Route]:
    """The cheapest path through the pieces (K, 3) [m] and all paths that cost up to `margin` more, cheapest first."""
    search = _Search(pieces, joined, length_m, margin)
    search.run()
    best = min((route.cost for route in search.found), default=np.inf)
    return sorted((route for route in search.found if route.cost <= best + margin), key=lambda route: route.cost)


class _Search:
    """Depth-first search from every end; branches that cost more than the best path plus the margin are pruned."""

    def __init__(self, pieces: list[Float64Array], joined: Links, length_m: float | None, margin: float) -> None:
        self._lengths = [float(arc_lengths(piece)[-1]) for piece in pieces]
        self._cost = joined.cost.tolist()
        self._link_m = joined.length_m.tolist()
        self._onward = [[int(b) for b in np.argsort(row) if np.isfinite(row[b])] for row in joined.cost]
        self._length_m = length_m
        self._margin = margin
        self._best = np.inf
        self._steps = 0
        self.found: list[Route] = []

    def run(self) -> None:
        """Search."""
        for start in range(2 * len(self._lengths)):
            self._extend([start], {start // 2}, 0.0, self._lengths[start // 2])

    def _extend(self, entered: list[int], used: set[int], cost: float, length_m: float) -> None:
        self._steps += 1
        self._keep(entered, used, cost, length_m)
        if self._steps > _MOST_STEPS:
            return
        leaving = entered[-1] ^ 1
        for end in self._onward[leaving]:
            onward = cost + self._cost[leaving][end]
            if onward > self._best + self._margin:
                return
            piece = end // 2
            if piece not in used:
                entered.append(end)
                used.add(piece)
                self._extend(entered, used, onward, length_m + self._link_m[leaving][end] + self._lengths[piece])
                used.remove(piece)
                entered.pop()

    def _keep(self, entered: list[int], used: set[int], cost: float, length_m: float) -> None:
        if entered[0] > (entered[-1] ^ 1):
            return  # the same path from its other end is kept instead
        omitted = sum(length for piece, length in enumerate(self._lengths) if piece not in used)
        total = cost + _OMITTED_PER_M * omitted
        if self._length_m is not None:
            off = (length_m / self._length_m - 1.0) / _LENGTH_SIGMA
            total += _LENGTH_COST * off**2
        if total <= self._best + self._margin:
            self._best = min(self._best, total)
            self.found.append(Route(cost=total, ends=tuple(entered), length_m=length_m))


def polyline(route: Route, pieces: list[Float64Array], joined: Links) -> Float64Array:
    """The pieces (K_i, 3) [m] of a path and the links between them as one line (K, 3) [m]."""
    parts: list[Float64Array] = []
    for place, end in enumerate(route.ends):
        if place > 0:
            parts.append(joined.points[route.ends[place - 1] ^ 1, end, 1:-1])
        parts.append(pieces[end // 2] if end % 2 == 0 else pieces[end // 2][::-1])
    return np.vstack(parts)


def faces_itself(line: Float64Array) -> bool:
    """Whether the two ends of a line (K, 3) [m] are close and point at each other, like the ends of a cut ring."""
    if float(np.linalg.norm(line[0] - line[-1])) > _FACING_M:
        return False
    _, outward, _, _ = _ends([line])
    return float(outward[0] @ outward[1]) < -0.5
