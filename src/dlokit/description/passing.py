"""On which side of the fixtures a path of points lies, for the estimate and for the truth alike.

The measure of a post is the directed winding of ManipulationNet's cable boards: the angle by which a path turns about
the post's axis within 50 mm of it, clockwise positive, seen from above along the axis. The side is the sign of the turn
within a circle that is larger where the post is farther away.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.scene import Box, Fixture, Post
from dlokit.errors import ConfigError
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.passing import TURNS, AsWished, BoxPassing, Passing, PostPassing, SideAnswer, SideWish

NEAR_M = 0.05
"""Radius around a post's axis within which the winding counts [m]; ManipulationNet's."""
CLOSELY_RAD = 2.6
"""Least winding of a DLO that passes closely [rad], ManipulationNet's: a straight one is within 13 mm of the axis."""
UNSURE_M = 0.003
"""An estimated side is decided by more than this [m]: twice the usual error of a node across the DLO."""
# Within a circle of twice its distance a straight path turns by 2.1 rad, one that ends beside the post by half of that,
# and one that bends away as tightly as a rope can by more than this [rad].
_PASSES_RAD = 1.0
_REACH = 2.0  # radius of that circle over the distance
# Posts abreast of each other to this [m] may be passed in either order: a DLO around two pegs touches each for 20 mm.
_ABREAST_M = 0.02
_SDS = 2.0  # standard deviations within which a point is believed to lie
_LOCATED_M = 0.01  # a point that may be farther away across the path counts as hidden [m]
_BOX_STEP_M = 0.002  # between the points that are measured from a box
_SIGNS: Mapping[str, int] = {"+": 1, "-": -1, "": 0}


def parse_wish(text: str, fixtures: Sequence[Fixture]) -> tuple[SideWish, ...]:
    """A wish such as ``-A +B``: posts in the order along the DLO; ``+``: clockwise. Raises `ConfigError`."""
    parts = [re.fullmatch(r"([+-]?)(\w+)", part) for part in text.split()]
    wish = tuple(SideWish(name=part[2], turn=_SIGNS[part[1]]) for part in parts if part)
    if len(wish) < len(parts):
        raise ConfigError(
            f'--beside is {text!r}; allowed are names of posts in the order along the DLO, as in "-A +B C": + passes '
            "clockwise, seen from above, - counterclockwise, no sign closely on either side."
        )
    check_wish(wish, fixtures)
    return wish


def check_wish(wish: Sequence[SideWish], fixtures: Sequence[Fixture]) -> None:
    """Raise `ConfigError` unless each name is that of a post, once."""
    posts, names = [one.name for one in fixtures if isinstance(one, Post)], [one.name for one in wish]
    if unknown := sorted(set(names) - set(posts)):
        allowed = f"the posts are {', '.join(posts)}" if posts else "the scene has none: describe them with --fixtures"
        raise ConfigError(f"--beside names {', '.join(unknown)}, which is no post; {allowed}.")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(f"--beside names {', '.join(twice)} twice; name a post once.")


def wish_along(path_world: Float64Array, fixtures: Sequence[Fixture]) -> tuple[SideWish, ...]:
    """The wish that a path (M, 3) [m] itself meets: the sides of the posts within 50 mm of it, in their order."""
    posts = [fact for fact in passing(path_world, fixtures).fixtures if isinstance(fact, PostPassing)]
    near = sorted((fact for fact in posts if fact.side and fact.distance_m < NEAR_M), key=lambda fact: fact.along_m)
    return tuple(SideWish(name=fact.name, turn=1 if fact.side > 0 else -1) for fact in near)


def passing(
    path_world: Float64Array,
    fixtures: Sequence[Fixture],
    wish: Sequence[SideWish] = (),
    *,
    visible: BoolArray | None = None,
    covariance: Float64Array | None = None,
    ends_interchangeable: bool = False,
    unsure_m: float = UNSURE_M,
) -> Passing:
    """How a path of points in order, (N, 3) [m], passes fixtures, and whether it does so as wished.

    `visible` (N,) marks seen points, None: all; `covariance` (N, 3, 3) [m²] is of each, None: unknown. An answer with a
    margin up to `unsure_m` [m] is *not seen*; it is 0 for the truth. With `ends_interchangeable` the wish may be met in
    either direction.
    """
    posts = {one.name: one for one in fixtures if isinstance(one, Post)}
    course = _course(path_world[None], list(posts.values()))
    facts = {name: _post_passing(course, at, name) for at, name in enumerate(posts)}
    needs_m, directions = _needs_m(course, list(posts.values()), wish, ends_interchangeable=ends_interchangeable)
    answers: list[SideAnswer] = []
    for number, (one, (turn_m, order_m)) in enumerate(zip(wish, needs_m[0].tolist(), strict=True)):
        points, post = course.points[:2, 0, list(posts).index(one.name)].T, posts[one.name]
        seen = _located(points, visible, covariance, post)
        sight_m, least_m = _sight_m(points, course.arc_m[0], seen, post.diameter_m / 2.0), min(turn_m, order_m)
        margin_m = max(min(abs(least_m), sight_m), 0.0)
        decided = AsWished.YES if least_m > 0.0 else AsWished.NO
        answer = decided if margin_m > unsure_m else AsWished.NOT_SEEN
        before = wish[number - 1].name if order_m < min(turn_m, 0.0) else ""
        why = _why(answer, one, facts[one.name], int(directions[0]), before)
        answers.append(SideAnswer(name=one.name, turn=one.turn, answer=answer, margin_m=margin_m, why=why))
    named = {one.name for one in wish}
    near = (fact.name for fact in facts.values() if fact.side and fact.distance_m < NEAR_M)
    return Passing(
        fixtures=tuple(facts[one.name] if isinstance(one, Post) else _box_passing(path_world, one) for one in fixtures),
        answers=tuple(answers),
        unnamed=tuple(name for name in near if name not in named) if wish else (),
        slack=_slack([facts[one.name] for one in wish], [posts[one.name] for one in wish], float(directions[0])),
    )


def wrong_sides(
    paths_world: Float64Array,
    fixtures: Sequence[Fixture],
    wish: Sequence[SideWish],
    *,
    ends_interchangeable: bool = False,
) -> Int64Array:
    """Number of named posts (K,) that each of the paths (K, M, 3) [m] does not pass as wished."""
    if not wish:
        return np.zeros(len(paths_world), np.int64)
    posts = [one for one in fixtures if isinstance(one, Post)]
    course = _course(paths_world, posts)
    needs_m, _ = _needs_m(course, posts, wish, ends_interchangeable=ends_interchangeable)
    return np.sum(~(needs_m.min(axis=2) > 0.0), axis=1)  # NaN is wrong


@dataclass(frozen=True)
class _Course:
    """How K paths of M points pass P posts, each seen along its axis."""

    points: Float64Array  # (3, K, P, M) x and y from the axis and height over the foot [m]
    arc_m: Float64Array  # (K, M) arc length of the points [m]
    winding_rad: Float64Array  # (K, P) within `NEAR_M`, clockwise positive
    turn_rad: Float64Array  # (K, P) the same within `reach_m`
    reach_m: Float64Array  # (K, P)
    distance_m: Float64Array  # (K, P) of the point nearest to the axis
    along_m: Float64Array  # (K, P) arc length of that point
    over: BoolArray  # (K, P) whether it lies over the head


def _course(paths_world: Float64Array, posts: Sequence[Post]) -> _Course:
    """The courses of paths (K, M, 3) [m]."""
    feet = np.array([geometry.matrix(post.T_world_foot) for post in posts]).reshape(-1, 4, 4)
    radii_m, heights_m = np.array([(post.diameter_m / 2.0, post.height_m) for post in posts]).reshape(-1, 2).T
    local = (paths_world[:, None] - feet[:, None, :3, 3]) @ feet[:, :3, :3]
    points = np.ascontiguousarray(np.moveaxis(local, -1, 0))  # sums over a last axis of three would be slow
    begins, lines = points[..., :-1], np.diff(points)
    steps_m = np.linalg.norm(np.diff(paths_world, axis=1), axis=2)
    arc_m = np.pad(np.cumsum(steps_m, axis=1), ((0, 0), (1, 0)))
    bd, dd = _dot(begins, lines), np.maximum(_dot(lines, lines), np.finfo(np.float64).tiny)
    part = np.clip(-bd / dd, 0.0, 1.0)
    nearest = begins + part * lines
    squares = _dot(nearest, nearest)
    at = np.argmin(squares, axis=2)
    distance_m, height_m = np.sqrt(_at(squares, at)), _at(nearest[2], at)
    reach_m = np.maximum(NEAR_M, _REACH * distance_m)
    return _Course(
        points=points,
        arc_m=arc_m,
        winding_rad=_winding_rad(begins, lines, np.full_like(reach_m, NEAR_M)),
        turn_rad=_winding_rad(begins, lines, reach_m),
        reach_m=reach_m,
        distance_m=distance_m,
        along_m=np.take_along_axis(arc_m, at, axis=1) + _at(part, at) * np.take_along_axis(steps_m, at, axis=1),
        over=(distance_m < radii_m) & (height_m > heights_m - radii_m),  # rounded from one radius below the top
    )


def _dot(u: Float64Array, v: Float64Array) -> Float64Array:
    return u[0] * v[0] + u[1] * v[1]


def _at(values: Float64Array, at: Int64Array) -> Float64Array:
    """The value (K, P) of the segments `at`, of values (K, P, M - 1)."""
    return np.take_along_axis(values, at[..., None], axis=2)[..., 0]


def _winding_rad(begins: Float64Array, lines: Float64Array, radius_m: Float64Array) -> Float64Array:
    """Clockwise angle (K, P) by which segments (3, K, P, M - 1) turn about their axes within circles (K, P) [m]."""
    bb, bd, dd = _dot(begins, begins), _dot(begins, lines), np.maximum(_dot(lines, lines), np.finfo(np.float64).tiny)
    root = np.sqrt(np.maximum(bd**2 - dd * (bb - radius_m[..., None] ** 2), 0.0))
    t0, t1 = np.clip((-bd - root) / dd, 0.0, 1.0), np.clip((-bd + root) / dd, 0.0, 1.0)
    # The angle between the points at t0 and t1, by their cross and dot product.
    cross = (t1 - t0) * (begins[0] * lines[1] - begins[1] * lines[0])
    return -np.sum(np.arctan2(cross, bb + (t0 + t1) * bd + t0 * t1 * dd), axis=-1)


def _needs_m(
    course: _Course, posts: Sequence[Post], wish: Sequence[SideWish], *, ends_interchangeable: bool
) -> tuple[Float64Array, Float64Array]:
    """By how much each path meets the wish [m], (K, W, 2): the turn and the order; negative: it does not.

    Also the direction (K,) of each path that meets it better: 1 or, if the ends are interchangeable, -1.
    """
    forward, turned = (_one_way_m(course, posts, wish, direction) for direction in (1.0, -1.0))
    better = turned.min(axis=(1, 2), initial=np.inf) > forward.min(axis=(1, 2), initial=np.inf)
    directions = np.where(better & ends_interchangeable, -1.0, 1.0)
    return np.where(directions[:, None, None] < 0.0, turned, forward), directions


def _one_way_m(course: _Course, posts: Sequence[Post], wish: Sequence[SideWish], direction: float) -> Float64Array:
    names = [post.name for post in posts]
    at, turns = [names.index(one.name) for one in wish], np.array([one.turn for one in wish])
    ends_m = np.linalg.norm(course.points[:2, :, at][..., [0, -1]], axis=0).min(axis=-1)
    distance_m, reach_m = course.distance_m[:, at], np.where(turns, course.reach_m[:, at], NEAR_M)
    excess_rad = np.where(
        turns,
        turns * direction * course.turn_rad[:, at] - _PASSES_RAD,
        np.abs(course.winding_rad[:, at]) - CLOSELY_RAD,
    )
    # The turn depends on where the path enters and leaves the circle, and on which side of the axis it passes.
    turn_m = np.clip(0.5 * excess_rad * np.minimum(ends_m, reach_m), -distance_m, distance_m)
    radii_m = np.array([posts[number].diameter_m / 2.0 for number in at])
    turn_m = np.where(course.over[:, at], np.minimum(turn_m, distance_m - radii_m), turn_m)
    order_m = np.diff(direction * course.along_m[:, at], axis=1, prepend=-np.inf) + _ABREAST_M
    return np.stack((turn_m, order_m), axis=2)


def _located(points: Float64Array, visible: BoolArray | None, covariance: Float64Array | None, post: Post) -> BoolArray:
    """Which points (N,), (N, 2) [m] from a post's axis, are known across the path."""
    seen = np.ones(len(points), np.bool_) if visible is None else visible
    if covariance is None:
        return seen
    along = geometry.tangents(points)
    across = np.column_stack((-along[:, 1], along[:, 0])) @ geometry.rotation(post.T_world_foot)[:, :2].T
    off_m = _SDS * np.sqrt(np.einsum("ni,nij,nj->n", across, covariance, across))
    return seen & (off_m < np.minimum(np.linalg.norm(points, axis=1), _LOCATED_M))


def _sight_m(points: Float64Array, arc_m: Float64Array, seen: BoolArray, radius_m: float) -> float:
    """By how much the hidden parts of a path (N, 2) [m] are too short to pass the post at the origin otherwise [m]."""
    numbers = np.flatnonzero(seen)
    if len(numbers) == 0:
        return 0.0
    away_m, angles = np.linalg.norm(points, axis=1), np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    # A free end may come so near that it turns by 30° about the axis.
    ends = ((i, abs(arc_m[i] - arc_m[end])) for i, end in ((numbers[0], 0), (numbers[-1], -1)))
    spare_m = [away_m[i] - 0.5 * min(away_m[i], NEAR_M) - hidden_m for i, hidden_m in ends if hidden_m > 0.0]
    # The shortest line around the post's other side touches it between two straight parts.
    away_m = np.maximum(away_m, radius_m)
    straight_m, straight_rad = np.sqrt(away_m**2 - radius_m**2), np.arccos(radius_m / away_m)
    for i, j in itertools.pairwise(numbers):
        if j > i + 1:
            touching_rad = 2.0 * np.pi - abs(angles[j] - angles[i]) - straight_rad[i] - straight_rad[j]
            around_m = straight_m[i] + straight_m[j] + radius_m * touching_rad
            spare_m.append(0.5 * (around_m - (arc_m[j] - arc_m[i])))
    return float(min(spare_m, default=np.inf))


def _post_passing(course: _Course, at: int, name: str) -> PostPassing:
    turn_rad, over = float(course.turn_rad[0, at]), bool(course.over[0, at])
    return PostPassing(
        name=name,
        side=0 if over or abs(turn_rad) < _PASSES_RAD else int(np.sign(turn_rad)),
        winding_rad=float(course.winding_rad[0, at]),
        along_m=float(course.along_m[0, at]),
        distance_m=float(course.distance_m[0, at]),
        over=over,
    )


def _why(answer: AsWished, wished: SideWish, fact: PostPassing, direction: int, before: str) -> str:
    """What is not as wished; `before` names a post that should come earlier."""
    if answer is AsWished.NOT_SEEN:
        return f"is not seen well enough beside {fact.name}"
    if answer is AsWished.YES:
        return ""
    if before:
        return f"passes {fact.name} before {before}"
    if fact.over:
        return f"lies over {fact.name}"
    if wished.turn and fact.side:
        return f"passes {fact.name} {TURNS[direction * fact.side]}"
    return f"does not pass {fact.name}{'' if wished.turn else ' ' + TURNS[0]}"


def _box_passing(path_world: Float64Array, box: Box) -> BoxPassing:
    length_m = geometry.arc_lengths(path_world)[-1]
    fine = geometry.resample(path_world, max(2, int(length_m / _BOX_STEP_M) + 1))
    inside = (fine - box.T_world_foot.position_m) @ geometry.rotation(box.T_world_foot)
    away_m = np.linalg.norm(np.maximum(np.abs(inside[:, :2]) - np.array(box.size_m[:2]) / 2.0, 0.0), axis=1)
    at = int(np.argmin(away_m))
    return BoxPassing(name=box.name, along_m=float(length_m * at / (len(fine) - 1)), distance_m=float(away_m[at]))


def _slack(facts: Sequence[PostPassing], posts: Sequence[Post], direction: float) -> float | None:
    """Slack between the first and the last post; straight lines pass a post at its radius, on the side of the path."""
    if len(posts) < 2:
        return None
    feet = np.array([post.position_m[:2] for post in posts])
    along = geometry.tangents(feet)
    left = np.column_stack((-along[:, 1], along[:, 0]))
    sideways_m = [fact.side * post.diameter_m / 2.0 for fact, post in zip(facts, posts, strict=True)]
    shortest_m = geometry.arc_lengths(feet + direction * np.array(sideways_m)[:, None] * left)[-1]
    return float(abs(facts[-1].along_m - facts[0].along_m) / shortest_m)
