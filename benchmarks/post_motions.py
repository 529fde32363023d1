"""How well does the planning rod predict motions in which the DLO touches posts?

    python benchmarks/post_motions.py
    python benchmarks/post_motions.py --count 30 --json post_motions.json

Draws random scenes of four to six posts beside a DLO, and in each a pick-and-place, a drag or a lay-down. The truth is
a rod of the cell's kind with its parameters, held by springs, among round posts whose friction differs from the
believed one. With the believed parameters, the planning rod predicts each motion without and with the posts, and a rod
in MuJoCo with them. Prints the distance of predictions from the truth (RMSE over the nodes) for the motions in which
the DLO touches a post, and in how many of them a prediction has the DLO on another side of a post.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit import geometry
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import NO_POSTS, Post, Scene
from dlokit.description.shapes import moved, random_shape, self_clearance_m
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median, without_interval
from dlokit.functional.cell.world import NODES
from dlokit.motion.tool_track import tool_track
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from parts.command import check_json, figures_table, run_study, value_in, write_figures
from parts.held_rod import TICK_S, HeldRod

BELIEVED = BelievedDlo()
_KINDS = ("pick-and-place", "drag", "lay-down")
_FRICTION = (0.7, 1.4)  # of a post, as a ratio of the true to the believed one
_GRASP_M = 0.011  # height of the tool at grasp and release
_LIFT_M, _DRAG_M, _HANG_M = 0.045, 0.003, 0.4  # of a pick-and-place, a drag and a lay-down
_FAR_M = (0.06, 0.15)  # displacement by a pick-and-place or a drag
_TURN_RAD = 0.8
_BESIDE_M = (0.013, 0.07)  # distance of a post's axis from the DLO at the start
_APART_M = 0.035  # between the axes of two posts
_FINGERS_M = 0.025  # from a post's axis to a tool that is lower than `_LIFT_M`
_FREE_S = 1.0
_STRANDS_M = 0.012  # between two strands of a DLO that are clear of each other
_ON_TABLE_M = 0.006  # highest node of a DLO that lies on the table alone


@dataclass(frozen=True, kw_only=True)
class Args:
    """Compare predictions of motions among posts with simulated ones."""

    count: int = 30
    """Number of motions in which the DLO touches a post."""
    seed: int = 0
    """First seed of the scenes."""
    json: Path | None = None
    """Also write every figure to this file."""


@dataclass(frozen=True, kw_only=True)
class Moved:
    """A motion in which the DLO touched a post."""

    kind: str
    posts: tuple[Post, ...]
    """As they are believed."""
    before_world: Float64Array  # (Mc, 3) [m]
    node: int
    """The held node of the believed rod."""
    tool: Float64Array  # (T, 4) x, y, z [m], yaw [rad] every `TICK_S`
    after_world: Float64Array  # (M, 3) [m] the true result


def run(args: Args) -> int:
    """Simulate, predict and print; exit code 0."""
    if args.count < 1:
        raise ConfigError(f"--count is {args.count}; it must be 1 or greater.")
    check_json(args.json)
    console = Console()
    with console.status("motions among posts"):
        drawn, done = 0, list[Moved]()
        for one in _motions(args.seed):
            drawn += 1
            done += [] if one is None else [one]
            if len(done) == args.count:
                break
        figures = [row for name, method in _METHODS.items() for row in _figures(name, method, done)]
    caption = f"{len(done)} of {drawn} random motions, in which the DLO touches a post"
    columns = {
        "median [mm]": value_in("prediction error", 1e3, 1),
        "largest [mm]": value_in("largest prediction error", 1e3, 1),
        "other side": value_in("motions on another side"),
    }
    console.print(figures_table("prediction errors", caption, figures, columns))
    write_figures(args.json, "post_motions", figures, {"count": args.count, "seed": args.seed}, console)
    return 0


def _figures(name: str, method: Callable[[Moved], Float64Array], done: Sequence[Moved]) -> list[BenchFigure]:
    """The figures of a method: of all motions, then of each kind."""
    predicted = [method(one) for one in done]
    errors_m = np.array([geometry.rmse_m(nodes, one.after_world) for nodes, one in zip(predicted, done, strict=True)])
    wrong = np.array([_on_another_side(nodes, one) for nodes, one in zip(predicted, done, strict=True)])
    rows = list[BenchFigure]()
    for kind in ("", *_KINDS):
        some = np.array([kind in ("", one.kind) for one in done])
        case, count = f"{name}, {kind}" if kind else name, int(some.sum())
        if count:
            largest_m, others = float(errors_m[some].max()), float(wrong[some].sum())
            rows += [
                figure(case, name, "prediction error", median(errors_m[some].tolist()), "m"),
                figure(case, name, "largest prediction error", without_interval(largest_m, count), "m"),
                figure(case, name, "motions on another side", without_interval(others, count), "motions"),
            ]
    return rows


def _motions(seed: int) -> Iterator[Moved | None]:
    """Motions of all kinds in turn; None where the DLO touched no post, or came to lie across itself or a post.

    The planning rod does not collide with itself, and planners discard such actions.
    """
    number = 0
    while True:
        rng = np.random.default_rng([seed, number])
        kind = _KINDS[number % len(_KINDS)]
        number += 1
        before = random_shape(rng, SOFT_ROPE.length_m, NODES)
        node = int(rng.choice([0, NODES - 1]) if kind == "lay-down" else rng.integers(NODES))
        if kind == "lay-down":
            held = before if node == NODES - 1 else before[::-1]  # it begins with the free end
            goal = moved(held, (0.0, 0.0), rng.uniform(-_TURN_RAD, _TURN_RAD))
            goal += held[0] - goal[0]
            waypoints, pace = _laying(held, goal)
        else:
            goal = before
            waypoints, pace = _carrying(kind, before, node, rng)
        posts = _posts_beside(before, goal, rng)
        tool = tool_track(waypoints, pace.speed_m_s, pace.acceleration_m_s2, pace.jerk_m_s3, TICK_S)
        if not posts or _strikes(tool, posts):
            continue
        rod = HeldRod(SOFT_ROPE, [replace(post, friction=post.friction * rng.uniform(*_FRICTION)) for post in posts])
        after = rod.after(before, tool, _FREE_S)
        tangled = self_clearance_m(after) < _STRANDS_M or float(after[:, 2].max()) > _ON_TABLE_M
        if tangled or not rod.touched_post:
            yield None
            continue
        yield Moved(
            kind=kind,
            posts=posts,
            before_world=before,
            node=round(node * (BELIEVED.nodes - 1) / (NODES - 1)),
            tool=tool,
            after_world=geometry.resample(after, BELIEVED.nodes),
        )


def _carrying(
    kind: str, nodes_world: Float64Array, node: int, rng: np.random.Generator
) -> tuple[Float64Array, VelocityProfile]:
    """Waypoints (W, 4) of a tool that carries or drags `node` of a rod (Mc, 3) [m], and how fast it follows them."""
    heading, far_m, turn = rng.uniform(-np.pi, np.pi), rng.uniform(*_FAR_M), rng.uniform(-_TURN_RAD, _TURN_RAD)
    grasp = _grasp(nodes_world, node)
    up = np.array([0.0, 0.0, _LIFT_M if kind == "pick-and-place" else _DRAG_M, 0.0])
    over = grasp + up + np.array([far_m * np.cos(heading), far_m * np.sin(heading), 0.0, turn])
    return np.stack((grasp, grasp + up, over, over - up)), VelocityProfile()


def _laying(nodes_world: Float64Array, goal_world: Float64Array) -> tuple[Float64Array, VelocityProfile]:
    """The same of a tool that holds the last node and lays the rod along a goal (Mc, 3) [m], its first node first."""
    grasp, there = _grasp(nodes_world, NODES - 1), _grasp(goal_world, NODES - 1)
    along = np.linspace(0.0, 1.0, 9)
    turn = np.angle(np.exp(1j * (there[3] - grasp[3])))
    heights, yaws = _GRASP_M + _HANG_M * (1.0 - along), grasp[3] + turn * along
    path = np.column_stack((geometry.resample(goal_world, len(along))[:, :2], heights, yaws))
    lifted = grasp + np.array([0.0, 0.0, _HANG_M, 0.0])
    return np.vstack((grasp, lifted, path)), VelocityProfile(speed_m_s=0.22, acceleration_m_s2=0.6, jerk_m_s3=6.0)


def _grasp(nodes_world: Float64Array, node: int) -> Float64Array:
    """The tool (4,) at a node of a rod (Mc, 3) [m], along it."""
    ahead = geometry.tangents(nodes_world)[node]
    return np.array([*nodes_world[node, :2], _GRASP_M, np.arctan2(ahead[1], ahead[0])])


def _posts_beside(nodes_world: Float64Array, goal_world: Float64Array, rng: np.random.Generator) -> tuple[Post, ...]:
    """Four to six posts beside a goal (Mc, 3) [m], clear of it and of a rod (Mc, 3) [m]; none without room."""
    wanted, places = int(rng.integers(4, 7)), list[Float64Array]()
    curves = [geometry.resample(nodes, 4 * NODES)[:, :2] for nodes in (nodes_world, goal_world)]
    for _ in range(200):
        place = goal_world[rng.integers(NODES), :2] + rng.uniform(-1.0, 1.0, 2) * _BESIDE_M[1]
        from_rod_m, from_goal_m = (float(np.linalg.norm(curve - place, axis=1).min()) for curve in curves)
        apart_m = min((float(np.linalg.norm(place - other)) for other in places), default=np.inf)
        if min(from_rod_m, from_goal_m) > _BESIDE_M[0] and from_goal_m < _BESIDE_M[1] and apart_m > _APART_M:
            places.append(place)
        if len(places) == wanted:
            return tuple(
                Post(name=f"post_{k}", position_m=(float(at[0]), float(at[1]), 0.0)) for k, at in enumerate(places)
            )
    return ()


def _strikes(tool: Float64Array, posts: Sequence[Post]) -> bool:
    """Whether fingers at `tool` (T, 4) would strike a post."""
    low = tool[tool[:, 2] < _LIFT_M]
    places = np.array([post.position_m[:2] for post in posts])
    return bool((np.linalg.norm(low[:, None, :2] - places, axis=2) < _FINGERS_M).any())


def _planning_rod(one: Moved, *, with_posts: bool = True) -> Float64Array:
    motion = Motion(node=one.node, waypoints=one.tool[[0, -1]], velocity=VelocityProfile(), track=one.tool)
    posts = Scene(fixtures=one.posts).posts_world if with_posts else NO_POSTS
    result = simulate(BELIEVED, one.before_world, (PlanningRod(),), (motion,), TICK_S, threads=1, posts=posts)
    return result.nodes_world[0, 0]


def _mujoco_rod(one: Moved) -> Float64Array:
    dlo = replace(
        SOFT_ROPE,
        bending_stiffness_n_m2=BELIEVED.bending_stiffness_n_m2,
        mass_per_length_kg_m=BELIEVED.mass_kg_m,
        friction=BELIEVED.friction,
    )
    after = HeldRod(dlo, one.posts).after(one.before_world, one.tool, _FREE_S)
    return geometry.resample(after, BELIEVED.nodes)


_METHODS: Mapping[str, Callable[[Moved], Float64Array]] = {
    "planning rod without posts": partial(_planning_rod, with_posts=False),
    "planning rod with posts": _planning_rod,
    "MuJoCo with posts": _mujoco_rod,
}


def _on_another_side(nodes_world: Float64Array, one: Moved) -> bool:
    """Whether a predicted rod (M, 3) [m] is on another side of a post than the true one: a whole turn less or more."""
    turns_rad = [_winding_rad(nodes_world, post) - _winding_rad(one.after_world, post) for post in one.posts]
    return bool(np.any(np.abs(turns_rad) > np.pi))


def _winding_rad(nodes_world: Float64Array, post: Post) -> float:
    """The angle that a rod (M, 3) [m] turns about a post, seen from above."""
    away = geometry.resample(nodes_world, 4 * NODES)[:, :2] - np.array(post.position_m[:2])
    angles = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(angles[-1] - angles[0])


if __name__ == "__main__":
    run_study(Args, run, __doc__)
