"""How a run goes on after a person has stopped an arm that carries the DLO: how often the next task converges.

    python benchmarks/stopped_carries.py --seeds 10

A task from I to S is stopped at a drawn moment of its first carry; then the arm is enabled and the task begins again,
as on the page by STOP, *Enable arms* and *Shape it*. The next task first puts down what the fingers hold. Beside it, in
the same cell and at the same moment: the fingers open where they are.
"""

import asyncio
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from dlokit.communication.timing import virtual_time
from dlokit.decision.component import OperatorStart
from dlokit.decision.records import ActionRecord, ShapeResult
from dlokit.decision.steps import put_down
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import success_rate, without_interval
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.lockstep import lockstep_system
from dlokit.types.flow import FlowStatus, RunOutcome
from parts.command import check_json, run_study, seeds_of, write_figures

METHODS = ("put down", "opened in the air")
LATEST_S = 8.0
"""Latest moment of the stop after the begin of the carry [s]; a carry takes about 9 s."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Stop carries at drawn moments, go on, and count what becomes of the next tasks."""

    seeds: int = 10
    """Tasks, with seeds from `first_seed` on."""
    first_seed: int = 500
    """First seed."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    seeds = seeds_of(args.seeds, args.first_seed)
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    paths, rows = put_down.paths_down, list[BenchFigure]()
    for method in METHODS:
        put_down.paths_down = paths if method == METHODS[0] else lambda *_: ()
        ends = list[ShapeResult]()
        for seed in seeds:
            after_s, end = virtual_time.run(_stopped_and_on(seed))
            error = f", RMSE {end.rmse_m * 1000.0:.1f} mm" if np.isfinite(end.rmse_m) else ""
            console.print(
                f"{method:18} seed {seed}, stopped after {after_s:.1f} s of the carry: {end.outcome.value} after "
                f"{len(end.history)} actions{error}{f' ({end.reason})' if end.reason else ''}"
            )
            ends.append(end)
        converged = [end for end in ends if end.outcome is RunOutcome.CONVERGED]
        outcomes = ", ".join(f"{count} {name}" for name, count in Counter(end.outcome.value for end in ends).items())
        actions = float(np.median([len(end.history) for end in converged])) if converged else float("nan")
        console.print(
            f"{method:18} {outcomes} of {len(ends)} next tasks; {actions:g} actions (median of the converged)"
        )
        rows.append(figure("I to S", method, "next task converged", success_rate(len(converged), len(ends)), ""))
        rows.append(figure("I to S", method, "actions", without_interval(actions, len(converged)), ""))
    put_down.paths_down = paths
    write_figures(args.json, "stopped carries", rows, {"seeds": args.seeds, "first_seed": args.first_seed}, console)
    return 0


def _unrecorded(record: ActionRecord) -> None:
    """The result has the actions too."""


async def _stopped_and_on(seed: int) -> tuple[float, ShapeResult]:
    """The moment of the stop, after the begin of the carry [s], and the end of the next task."""
    config = RunConfig(headless=True, seed=seed, cell=CellConfig(randomised=EVERY_FACTOR))
    job, carries = job_from_config(config), asyncio.Event()
    after_s = float(np.random.default_rng([seed, 0x57]).uniform(0.0, LATEST_S))

    def entered(status: FlowStatus) -> None:
        if status.step == "move_to_goal":
            carries.set()

    async with lockstep_system(config, job.start_nodes_world, None) as system, system.host.guarded():
        task = asyncio.ensure_future(system.decision.shape(job.request, _unrecorded, entered))
        await carries.wait()
        await system.clock.sleep(after_s)
        await system.transport.call(robot.STOP)
        await task
        await system.transport.call(robot.ENABLE)
        return after_s, await system.decision.shape(job.request, _unrecorded, start=OperatorStart(takes_over=True))


if __name__ == "__main__":
    run_study(Args, run, __doc__)
