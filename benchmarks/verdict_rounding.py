"""How much verdicts on goals depend on rounding: each goal is judged as it is, and moved by 1e-12 of its coordinates.

    python benchmarks/verdict_rounding.py --goals 1000 --jobs 2

Goals are made up as `benchmarks/feasibility.py` does it, for rods of 1 to 40 times the default stiffness. Prints how
many verdicts differ, and for each of them how far its figures are from the limit that they crossed.
"""

import asyncio
import time
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import track

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import success_rate, without_interval
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.rod.believed import BelievedDlo, as_configured
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import Workplace
from dlokit.skills.planning.verdict.goal_verdict import INFEASIBLE_FACTOR, judge
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from parts.command import check_json, run_study, write_figures
from parts.made_goals import made_goals

RELATIVE = 1e-12
THRESHOLD_M = 0.012
STIFFER = (1.0, 40.0)  # than the default rope
PLANNING = PlanningConfig()


@dataclass(frozen=True)
class Judged:
    """A verdict, and the figures that it was decided by as fractions of their limits."""

    verdict: GoalVerdict
    springs_back: float
    attainable: float

    def apart(self, other: "Judged") -> str:
        """What differs between two verdicts on one goal; empty when they are alike."""
        if self.verdict.standing is other.verdict.standing and _problems(self) == _problems(other):
            return ""
        return (
            f"{self.verdict.standing.value} {_problems(self)} / {other.verdict.standing.value} {_problems(other)}; of "
            f"their limits: springs back {self.springs_back:.3f} / {other.springs_back:.3f}, attainable "
            f"{self.attainable:.3f} / {other.attainable:.3f}"
        )


def _problems(judged: Judged) -> list[str]:
    return [finding.problem.value for finding in judged.verdict.findings]


def judged(goal_world: Float64Array, model: BelievedDlo) -> Judged:
    """The verdict on a goal (M, 3) [m] for the rod of `model`, as configured."""
    holds = list[goal_verdict.HoldVerdict]()

    async def try_goal(nodes_world: Float64Array) -> goal_verdict.HoldVerdict:
        belief = as_configured(model, 0)
        holds.append(goal_verdict.try_goal(model, belief, nodes_world, THRESHOLD_M, PLANNING.feasibility))
        return holds[-1]

    place = Workplace(model, PLANNING.feasibility, ArmKinematics(PANDA).reachable, default_calibration())
    verdict = asyncio.run(
        judge(GoalShape(stamp_ns=0, nodes_world=goal_world), THRESHOLD_M, place=place, try_goal=try_goal)
    )
    if not holds:
        return Judged(verdict, np.nan, np.nan)
    worst_m = max(release.rmse_m for release in holds[0].releases)
    limits = PLANNING.feasibility.hold_fraction * THRESHOLD_M, INFEASIBLE_FACTOR * THRESHOLD_M
    return Judged(verdict, worst_m / limits[0], holds[0].attainable_rmse_m / limits[1])


def _compared(number: int, curve: Float64Array) -> tuple[str, float]:
    rng = np.random.default_rng(number)
    stiffer = float(np.exp(rng.uniform(*np.log(STIFFER))))
    default = BelievedDlo()
    model = replace(default, bending_stiffness_n_m2=stiffer * default.bending_stiffness_n_m2)
    goal = geometry.resample(curve, model.nodes)
    moved = goal * (1.0 + RELATIVE * rng.uniform(-1.0, 1.0, goal.shape))
    before, after = judged(goal, model), judged(moved, model)
    nearest = [one.verdict.nearest_world for one in (before, after)]
    apart_m = 0.0
    if nearest[0] is not None and nearest[1] is not None:
        apart_m = float(np.abs(nearest[0] - nearest[1]).max())
    return before.apart(after), apart_m


@dataclass(frozen=True, kw_only=True)
class Args:
    """Judge goals as they are, and moved by 1e-12 of their coordinates."""

    goals: int = 1000
    """Goals, each judged twice."""
    jobs: int = 1
    """Processes side by side."""
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Judge, compare and print; exit code 0."""
    if args.goals < 1 or args.jobs < 1:
        raise ConfigError(f"--goals {args.goals} and --jobs {args.jobs} must be at least 1.")
    check_json(args.json)
    default, began_s, console = BelievedDlo(), time.perf_counter(), Console(highlight=False, soft_wrap=True)
    made = (curve for seed in count() for _, curve in made_goals(seed, default.length_m, default.radius_m))
    parallel: Any = Parallel(n_jobs=args.jobs, return_as="generator")
    todo = (delayed(_compared)(number, curve) for number, curve in enumerate(islice(made, args.goals)))
    compared = list(track(parallel(todo), "goals", args.goals, console=console, transient=True))
    differ = [(number, text) for number, (text, _) in enumerate(compared) if text]
    farthest_m = max(apart_m for _, apart_m in compared)
    console.print(f"{len(differ)} of {args.goals} verdicts differ; {time.perf_counter() - began_s:.0f} s")
    console.print(f"nearest shapes that hold are at most {farthest_m * 1000.0:.2g} mm apart")
    for number, text in differ:
        console.print(f"goal {number}: {text}")
    rows = [
        figure("all", "dlokit", "verdicts that differ", success_rate(len(differ), args.goals), ""),
        figure("all", "dlokit", "nearest shapes apart, largest", without_interval(farthest_m, args.goals), "m"),
    ]
    write_figures(args.json, "verdict_rounding", rows, {"goals": args.goals, "relative": RELATIVE}, console)
    return 0


if __name__ == "__main__":
    run_study(Args, run, __doc__)
