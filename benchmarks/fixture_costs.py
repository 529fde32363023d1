"""What fixtures cost: the checks of a motion (limits, table, the arm itself, fixtures), and rollouts of the rod.

python benchmarks/fixture_costs.py
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.description.scene import NO_POSTS, Fixture, Post, Scene
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from dlokit.geometry import downward
from dlokit.motion.fixture_clearance import hand_clearance_m
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory
from parts.command import check_json, run_study, write_figures

_WIDTH_M = 0.01
_RODS, _STEP_S = 16, 0.01  # variants of the rod, and the step of the search of `rollout`
_PATH = ((0.35, 0.0, 0.06, 0.0), (0.35, 0.0, 0.011, 0.0), (0.5, 0.0, 0.011, 0.0), (0.65, 0.0, 0.011, 0.0))
"""A drag between two rows of posts: x, y, z [m] and yaw [rad] of the tool."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Time the checks of motions and the rollouts of the rod with and without fixtures, and a hand's clearance."""

    fixtures: int = 10
    """Number of posts, in two rows, between which the arm moves."""
    repeats: int = 100
    """Number of checks of each motion, and of rollouts."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if args.fixtures < 1 or args.repeats < 2:
        raise ConfigError(f"--fixtures {args.fixtures} must be at least 1, and --repeats {args.repeats} at least 2.")
    check_json(args.json)
    posts = tuple(
        Post(name=f"post{i}", position_m=(0.35 + 0.06 * (i // 2), (-1.0) ** i * 0.08, 0.0))
        for i in range(args.fixtures)
    )
    console, rows = Console(highlight=False, soft_wrap=True), list[BenchFigure]()
    for case, (without_posts, among_posts) in _cases(posts).items():
        pairs = [(_spent_s(without_posts), _spent_s(among_posts)) for _ in range(args.repeats + 1)][
            1:
        ]  # the first compiles
        del pairs[0]  # its code is compiled or loaded
        without, with_posts = (median([pair[number] for pair in pairs]) for number in (0, 1))
        ratio = median([with_s / without_s for without_s, with_s in pairs])
        rows.append(figure(case, "without", "time", without, "s"))
        rows.append(figure(case, f"{args.fixtures} posts", "time", with_posts, "s"))
        rows.append(figure(case, f"{args.fixtures} posts", "time over that without", ratio, ""))
        console.print(f"{case}: {without.value * 1e3:.2f} ms, with fixtures {ratio.value:.2f} times as long")
    clearance = partial(hand_clearance_m, FIRST_ALONE[0].model, _PATH, _WIDTH_M, posts)
    times_s = [_spent_s(clearance) for _ in range(args.repeats + 1)][1:]
    rows.append(figure("path of the hand", f"{args.fixtures} posts", "time", median(times_s), "s"))
    console.print(f"clearance of a path of the hand: {rows[-1].value * 1e3:.2f} ms")
    write_figures(args.json, "fixture_costs", rows, {"fixtures": args.fixtures, "repeats": args.repeats}, console)
    return 0


_Work = Callable[[], object]


def _cases(posts: tuple[Post, ...]) -> dict[str, tuple[_Work, _Work]]:
    """What is timed without and with the posts."""
    arm = FIRST_ALONE[0].model
    kinematics = ArmKinematics(arm)
    (_, down, _, along) = (downward(place[:3], place[3]) for place in _PATH)
    above = kinematics.inverse(downward((0.35, 0.0, 0.1), 0.0))
    motions = {
        "checks of a joint move from home": joint_move(arm.home_q_rad, above, arm.limits),
        "checks of a drag": tool_move(kinematics, above, (down, along), VelocityProfile()),
    }
    checks = {case: (partial(_check, motion, ()), partial(_check, motion, posts)) for case, motion in motions.items()}
    rollouts = partial(_roll, NO_POSTS), partial(_roll, Scene(fixtures=posts).posts_world)
    return {**checks, "rollouts of a carry of the rod": rollouts}


def _check(motion: JointTrajectory, fixtures: tuple[Fixture, ...]) -> None:
    planned(ArmKinematics(FIRST_ALONE[0].model), lambda: motion, fixtures, _WIDTH_M)


def _roll(posts_world: Float64Array) -> None:
    """Carry the rod by a quarter of it over the posts, and let it go among them."""
    rod = BelievedDlo()
    nodes = builtin_shape("I", rod.length_m, rod.nodes, radius_m=rod.radius_m)
    x, y = nodes[rod.nodes // 4, :2]
    tool = np.array([(x, y, 0.011, 0.0), (x, y, 0.06, 0.0), (x - 0.1, y, 0.06, 0.5), (x - 0.1, y, 0.011, 0.5)])
    carry = Motion(node=rod.nodes // 4, waypoints=tool, velocity=VelocityProfile())
    simulate(rod, nodes, (PlanningRod(),) * _RODS, (carry,), _STEP_S, 1, posts=posts_world)


def _spent_s(work: _Work) -> float:
    """Processor time [s]."""
    began_s = time.process_time()
    work()
    return time.process_time() - began_s


if __name__ == "__main__":
    run_study(Args, run, __doc__)
