"""Posts and goal curves among them, given or drawn from a seed: the suites `posts` and `pegs`."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import Post
from dlokit.description.shapes import CURVE_POINTS
from dlokit.types.arrays import Float64Array

POST_DIAMETER_M, POST_HEIGHT_M = 0.010, 0.025
"""Size of a post: that of common routing boards [m]."""
BESIDE_M = 0.018
"""Distance of a post's axis from the goal curve beside which it stands [m]: 9 mm between their surfaces."""
_S_AT = (0.20, 0.36, 0.64, 0.80)  # fractions of the S's length beside which its posts stand, inside the bends
_I_AT = (0.2, 0.4, 0.6, 0.8)
_I_BESIDE_M = 0.03
_SLALOM_M = 0.10  # between two posts of the slalom
_SLALOM_SWING_M = 0.020  # of the curve to either side of their row
_SLALOM_POSTS = 4


@dataclass(frozen=True, kw_only=True)
class PlacedGoal:
    """A curve among posts, where it is."""

    points_m: tuple[tuple[float, float], ...]
    """(x, y) in the world [m], in order along the rod and of its length."""

    def nodes_world(self, length_m: float, radius_m: float) -> Float64Array:
        """The goal (CURVE_POINTS, 3) [m] of a rod of that radius [m]."""
        flat = np.array(self.points_m, dtype=np.float64)
        return geometry.resample(np.column_stack([flat, np.full(len(flat), radius_m)]), CURVE_POINTS)


def post(name: str, at_m: Float64Array, height_m: float = POST_HEIGHT_M) -> Post:
    """A post at a place (2,) [m], to the tenth of a millimetre."""
    x, y = (round(float(value), 4) for value in at_m)
    return Post(name=name, position_m=(x, y, 0.0), diameter_m=POST_DIAMETER_M, height_m=height_m)


def beside(curve_world: Float64Array, fractions: Sequence[float], beside_m: Sequence[float]) -> tuple[Post, ...]:
    """Posts A, B, … to the left of a curve (K, 3) [m] by `beside_m` [m], at fractions of its length."""
    fine = geometry.resample(curve_world, 20 * CURVE_POINTS)
    along = geometry.tangents(fine)[:, :2]
    posts: list[Post] = []
    for number, (fraction, away_m) in enumerate(zip(fractions, beside_m, strict=True)):
        at = round(fraction * (len(fine) - 1))
        left = np.array([-along[at, 1], along[at, 0]])
        posts.append(post(chr(ord("A") + number), fine[at, :2] + away_m * left))
    return tuple(posts)


def inside_s() -> tuple[Post, ...]:
    """Four posts inside the bends of the built-in S."""
    curve = shapes.builtin_shape("S", SOFT_ROPE.length_m, CURVE_POINTS)
    bends_left = _curvature(curve)[np.round(np.array(_S_AT) * (CURVE_POINTS - 1)).astype(np.int64)] > 0.0
    return beside(curve, _S_AT, np.where(bends_left, BESIDE_M, -BESIDE_M).tolist())


def along_i() -> tuple[Post, ...]:
    """Four posts beside the built-in I, alternately to its left and right."""
    curve = shapes.builtin_shape("I", SOFT_ROPE.length_m, CURVE_POINTS)
    return beside(curve, _I_AT, [_I_BESIDE_M, -_I_BESIDE_M, _I_BESIDE_M, -_I_BESIDE_M])


def slalom() -> tuple[tuple[Post, ...], PlacedGoal]:
    """Posts in a row, and a curve that passes them alternately."""
    row = [shapes.CENTRE_M[1] + _SLALOM_M * (k - 0.5 * (_SLALOM_POSTS - 1)) for k in range(_SLALOM_POSTS)]
    posts = tuple(post(chr(ord("A") + k), np.array([shapes.CENTRE_M[0], y])) for k, y in enumerate(row))
    y = np.linspace(row[0] - 0.5 * _SLALOM_M, row[-1] + 0.5 * _SLALOM_M, 20 * CURVE_POINTS)
    x = shapes.CENTRE_M[0] + _SLALOM_SWING_M * np.cos(np.pi * (y - row[0]) / _SLALOM_M)
    return posts, _placed(_prolonged(np.column_stack((x, y)), SOFT_ROPE.length_m))


def _placed(curve: Float64Array) -> PlacedGoal:
    """A curve (K, 2) or (K, 3) [m] to the hundredth of a millimetre, equal on every machine."""
    even = geometry.resample(np.column_stack((curve[:, :2], np.zeros(len(curve)))), CURVE_POINTS)
    return PlacedGoal(points_m=tuple((round(float(x), 5), round(float(y), 5)) for x, y in even[:, :2]))


def _curvature(curve_world: Float64Array) -> Float64Array:
    along = geometry.tangents(curve_world)[:, :2]
    return np.gradient(np.unwrap(np.arctan2(along[:, 1], along[:, 0])))


_STREAM = 0xF1  # separates these draws from all others of a seed
_FEWEST, _MOST = 3, 6  # posts
_GENTLE_M = 0.08  # tightest bend of a drawn goal, which friction alone holds
_NEAR = 0.6  # fraction of the posts that stand near the goal
_NEAR_M = (0.014, 0.045)  # how near
_FREE_M = 0.0135  # least distance of a post's axis from start and goal: 4.5 mm between the surfaces
_APART_M = 0.07
_ANYWHERE_M = np.array([shapes.RANDOM_X_M, shapes.RANDOM_Y_M]).T  # from and to (x, y)


def drawn(run_seed: int, start_world: Float64Array) -> tuple[tuple[Post, ...], PlacedGoal]:
    """Posts, clear of the start (K, 3) [m], and a goal curve among them, drawn from the seed of a run.

    Most stand near the goal, where they matter, the others anywhere; two posts leave room for a hand.
    """
    rng = np.random.default_rng([run_seed, _STREAM])
    goal = shapes.random_shape(rng, SOFT_ROPE.length_m, CURVE_POINTS, min_bend_radius_m=_GENTLE_M)
    wanted, places = int(rng.integers(_FEWEST, _MOST + 1)), list[Float64Array]()
    while len(places) < wanted:
        place = _near(goal, rng) if len(places) < _NEAR * wanted else rng.uniform(*_ANYWHERE_M)
        clear = _distance_m(place, goal) > _FREE_M and _distance_m(place, start_world) > _FREE_M
        if clear and all(float(np.linalg.norm(place - other)) > _APART_M for other in places):
            places.append(place)
    posts = tuple(post(chr(ord("A") + k), place) for k, place in enumerate(places))
    return posts, _placed(goal)


def _near(curve_world: Float64Array, rng: np.random.Generator) -> Float64Array:
    at = int(rng.integers(5, len(curve_world) - 5))
    along = geometry.tangents(curve_world)[at, :2]
    away_m = rng.uniform(*_NEAR_M) * rng.choice([-1.0, 1.0])
    place: Float64Array = curve_world[at, :2] + away_m * np.array([-along[1], along[0]])
    return place


def _distance_m(place: Float64Array, curve_world: Float64Array) -> float:
    return float(np.linalg.norm(geometry.resample(curve_world, 20 * CURVE_POINTS)[:, :2] - place, axis=1).min())


PEGS_LENGTH_M = 0.64
"""Length of the rope on the pegs [m]: twice the distance of the pegs, and the ends."""
PEG_HEIGHT_M = 0.0235
_PITCH_M = 0.010
_CELLS = ((20, 15), (12, 29))  # the pegs of tier 1 on the board's grid of 30 × 40
_ROUND_M = 0.016  # radius of the curve around a peg
_ARC_RAD = 1.2  # how far it goes round


def pegs() -> tuple[tuple[Post, ...], PlacedGoal]:
    """The two pegs of tier 1 of ManipulationNet's board `cable_management`, and a curve around them, -A +B.

    The board's middle is in the middle of the table. The curve passes A counterclockwise and B clockwise, each in an
    arc about its axis, with straight parts between.
    """
    places = _PITCH_M * (np.array(_CELLS, dtype=np.float64) - np.array([15.0, 20.0])) + np.array(shapes.CENTRE_M)
    posts = tuple(post(name, place, PEG_HEIGHT_M) for name, place in zip("AB", places, strict=True))
    first, second = places
    between = second - first
    # The straight part touches the circles around both pegs on opposite sides.
    slant = float(np.arcsin(2.0 * _ROUND_M / np.linalg.norm(between)))
    heading = float(np.arctan2(between[1], between[0])) + slant
    turning = heading - np.linspace(_ARC_RAD, 0.0, 40)
    around_first = first + _ROUND_M * _unit(turning - np.pi / 2.0)  # the peg is to the left
    around_second = second + _ROUND_M * _unit(turning[::-1] + np.pi / 2.0)
    return posts, _placed(_prolonged(np.vstack((around_first, around_second)), PEGS_LENGTH_M))


def _unit(angle_rad: Float64Array) -> Float64Array:
    return np.column_stack((np.cos(angle_rad), np.sin(angle_rad)))


def _prolonged(curve: Float64Array, length_m: float) -> Float64Array:
    """The curve (K, 2) [m] with straight ends of equal length, up to a length [m]."""
    left_m = 0.5 * (length_m - shapes.length(curve))
    begins, ends = curve[0] - curve[1], curve[-1] - curve[-2]
    first = curve[0] + left_m * begins / np.linalg.norm(begins)
    last = curve[-1] + left_m * ends / np.linalg.norm(ends)
    return np.vstack((np.linspace(first, curve[0], 60)[:-1], curve, np.linspace(curve[-1], last, 60)[1:]))
