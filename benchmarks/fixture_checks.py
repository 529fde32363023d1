"""What checking a motion costs with fixtures beside without: limits, table, the arm itself, and fixtures.

python benchmarks/fixture_checks.py
"""

import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.description.scene import Fixture, Post
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from dlokit.geometry import downward
from dlokit.motion.fixture_clearance import hand_clearance_m
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import JointTrajectory
from parts.command import check_json, run_study, write_figures

_WIDTH_M = 0.01
_PATH = ((0.35, 0.0, 0.06, 0.0), (0.35, 0.0, 0.011, 0.0), (0.5, 0.0, 0.011, 0.0), (0.65, 0.0, 0.011, 0.0))
"""A drag between two rows of posts: x, y, z [m] and yaw [rad] of the tool."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Time the checks of motions of the arm with and without fixtures, and the clearance of a hand's path."""

    fixtures: int = 10
    """Number of posts, in two rows, between which the arm moves."""
    repeats: int = 100
    """Number of checks of each motion."""
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
    for case, motion in _motions().items():
        pairs = [(_checking_s(motion, ()), _checking_s(motion, posts)) for _ in range(args.repeats + 1)][1:]
        without, with_posts = (median([pair[number] for pair in pairs]) for number in (0, 1))
        ratio = median([with_s / without_s for without_s, with_s in pairs])
        rows.append(figure(case, "without", "time", without, "s"))
        rows.append(figure(case, f"{args.fixtures} posts", "time", with_posts, "s"))
        rows.append(figure(case, f"{args.fixtures} posts", "time over that without", ratio, ""))
        console.print(f"{case}: {without.value * 1e3:.2f} ms, with fixtures {ratio.value:.2f} times as long")
    times_s = [_hand_s(posts) for _ in range(args.repeats + 1)][1:]  # the first loads compiled code
    rows.append(figure("path of the hand", f"{args.fixtures} posts", "time", median(times_s), "s"))
    console.print(f"clearance of a path of the hand: {rows[-1].value * 1e3:.2f} ms")
    write_figures(args.json, "fixture_checks", rows, {"fixtures": args.fixtures, "repeats": args.repeats}, console)
    return 0


def _motions() -> dict[str, JointTrajectory]:
    arm = FIRST_ALONE[0].model
    kinematics = ArmKinematics(arm)
    (_, down, _, along) = (downward(place[:3], place[3]) for place in _PATH)
    above = kinematics.inverse(downward((0.35, 0.0, 0.1), 0.0))
    return {
        "joint move from home": joint_move(arm.home_q_rad, above, arm.limits),
        "drag": tool_move(kinematics, above, (down, along), VelocityProfile()),
    }


def _checking_s(motion: JointTrajectory, fixtures: tuple[Fixture, ...]) -> float:
    began_s = time.process_time()
    planned(ArmKinematics(FIRST_ALONE[0].model), lambda: motion, fixtures, _WIDTH_M)
    return time.process_time() - began_s


def _hand_s(fixtures: tuple[Fixture, ...]) -> float:
    began_s = time.process_time()
    hand_clearance_m(FIRST_ALONE[0].model, _PATH, _WIDTH_M, fixtures)
    return time.process_time() - began_s


if __name__ == "__main__":
    run_study(Args, run, __doc__)
