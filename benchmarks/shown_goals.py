"""A goal shown by hand: the DLO lies in an S, the camera looks, the DLO is moved away, and the arm brings it back.

python benchmarks/shown_goals.py --seeds 10

In lockstep, one run a seed. The arm itself moves the DLO away, to a random shape: what it leaves there is not what it
was, as after a person's hand. The true error is the distance of the DLO at the end from where it lay when it was shown,
2 s after the last release; the system knows only what its camera saw.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit import geometry
from dlokit.app.console import prepare
from dlokit.communication.timing import virtual_time
from dlokit.decision.api import SEE_GOAL
from dlokit.decision.records import GoalRequest
from dlokit.description.shapes import CURVE_POINTS, random_shape
from dlokit.evaluation.evaluator import read_truth
from dlokit.extras.bench.report import BenchFigure
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import lockstep_system
from dlokit.system.shaping import LINGER_S
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Succeeded
from parts.command import check_json, run_study, seeds_of, write_figures


@dataclass(frozen=True, kw_only=True)
class Args:
    """Show an S, move the DLO away, and bring it back."""

    seeds: int = 10
    """Number of runs."""
    first_seed: int = 0
    """Seed of the first run; the others count on from it."""
    json: Path | None = None
    """Write the figures to this file."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One run."""

    outcome: str
    actions: int
    moved_m: float
    """RMSE of the DLO from where it was shown, before it was brought back [m]."""
    seen_m: float
    """Error of the goal that was seen (RMSE to the truth) [m]."""
    left_m: float
    """True RMSE at the end to where it was shown [m]."""


def run(args: Args) -> int:
    """Run, measure and print; exit code 0."""
    seeds = seeds_of(args.seeds, args.first_seed)
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    prepare(console, RunConfig(start="S", goal="S", headless=True))
    rows: list[BenchFigure] = []
    shown: list[Shown] = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            one = virtual_time.run(_shown(RunConfig(start="S", goal="S", seed=seed, headless=True), Path(folder)))
        shown.append(one)
        console.print(
            f"seed {seed}: {one.outcome} after {one.actions} actions; moved {one.moved_m * 1e3:.0f} mm away, goal seen "
            f"{one.seen_m * 1e3:.1f} mm off, brought back to {one.left_m * 1e3:.1f} mm"
        )
        rows += [_row(seed, "true_rmse", one.left_m, "m"), _row(seed, "actions", one.actions, "1")]
    back = sum(one.outcome == "converged" for one in shown)
    console.print(f"brought back: {back} of {len(shown)}")
    write_figures(args.json, "shown_goals", rows, {"seeds": args.seeds, "first_seed": args.first_seed}, console)
    return 0


def _row(seed: int, metric: str, value: float, unit: str) -> BenchFigure:
    return BenchFigure(
        case=f"seed {seed}", method="seen", metric=metric, value=float(value), low=None, high=None, unit=unit, n=1
    )


async def _shown(config: RunConfig, folder: Path) -> Shown:
    job = job_from_config(config)
    model = config.model
    away = random_shape(np.random.default_rng([config.seed, 7]), model.length_m, CURVE_POINTS, radius_m=model.radius_m)
    async with lockstep_system(config, job.start_nodes_world, folder) as system:
        seen = await system.transport.call(SEE_GOAL)
        assert isinstance(seen, Succeeded), seen
        shown_ns = system.clock.now_ns()
        goal = seen.result.nodes_world
        await system.decision.shape(GoalRequest(nodes_world=away, name="away"), lambda record: None)
        away_ns = system.clock.now_ns()
        back = await system.decision.shape(GoalRequest(nodes_world=goal, name="seen"), lambda record: None)
        await system.clock.sleep(LINGER_S)
        end_ns = system.clock.now_ns()
    truth = read_truth(folder)
    at_show = truth.at(shown_ns)
    return Shown(
        outcome=back.outcome.value,
        actions=len(back.history),
        moved_m=_rmse_m(truth.at(away_ns), at_show),
        seen_m=min(_rmse_m(goal, order) for order in (at_show, at_show[::-1])),
        left_m=_rmse_m(truth.at(end_ns), at_show),
    )


def _rmse_m(nodes: Float64Array, others: Float64Array) -> float:
    return geometry.rmse_m(nodes, geometry.resample(others, len(nodes)))


if __name__ == "__main__":
    run_study(Args, run, __doc__)
