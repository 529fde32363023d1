"""Three shaping tasks with the driver of the Franka against franky-sim, while the simulated cell mirrors its arm.

python benchmarks/franka_twin.py, after make test-peers has installed the simulator.

Each run is a usual live run with other settings: --arm fr3 --driver franka --twin. Differences are between the joints
that the driver reports and those of the cell's arm at the same time, by the recording of the run. The machine's load is
printed with every run: the simulator runs in real time on the same cores.
"""

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

from franky_server import why_not

from dlokit.app.console import prepare
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.bench.report import BenchFigure
from parts.command import check_json, run_study, seeds_of, write_figures
from parts.franka_twin_run import Mirrored, mirrored, twin_config, twin_run

TASKS = (("I", "S"), ("random", "S"), ("S", "I"))


@dataclass(frozen=True, kw_only=True)
class Args:
    """Shape the cell's rope with the simulated FR3."""

    seeds: int = 5
    """Number of runs of each task."""
    first_seed: int = 0
    """Seed of the first run; the others count on from it."""
    starts: Annotated[tuple[str, ...], tyro.conf.arg(metavar="START ...")] = tuple(start for start, _ in TASKS)
    """Tasks by their start: I and random go to S, S goes to I."""
    out: Path | None = None
    """Keep the folders of the runs here."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Run, measure and print; exit code 0."""
    goals = dict(TASKS)
    seeds = seeds_of(args.seeds, args.first_seed)
    if unknown := [start for start in args.starts if start not in goals]:
        raise ConfigError(f"--starts {unknown[0]} is none of {', '.join(goals)}.")
    check_json(args.json)
    if reason := why_not():
        raise MachineError(f"This study needs franky-sim: {reason}.")
    console = Console(highlight=False, soft_wrap=True)
    prepare(console, twin_config("I", "S", 0))
    rows: list[BenchFigure] = []
    with tempfile.TemporaryDirectory() as temporary:
        kept = args.out or Path(temporary)
        for start in args.starts:
            for seed in seeds:
                folder = kept / f"{start}-{goals[start]}-{seed}"
                folder.mkdir(parents=True)
                rows += _measured(start, goals[start], seed, folder, console)
    write_figures(args.json, "franka_twin", rows, {"seeds": args.seeds, "first_seed": args.first_seed}, console)
    return 0


def _measured(start: str, goal: str, seed: int, folder: Path, console: Console) -> list[BenchFigure]:
    case = f"{start} to {goal}, seed {seed}"
    result = twin_run(twin_config(start, goal, seed), folder)
    found = mirrored(folder)
    true_mm = "-" if result.true_rmse_m is None else f"{1e3 * result.true_rmse_m:.1f} mm"
    console.print(
        f"{case}: {result.outcome.value}, {result.actions} actions, true error {true_mm}, {result.wall_time_s:.0f} s; "
        f"twin {found.twin_hz:.0f} Hz (longest gap {1e3 * found.longest_gap_s:.0f} ms), driver {found.driver_hz:.0f} "
        f"Hz; joints {1e3 * found.median_rad:.1f} mrad off (median), {1e3 * found.largest_rad:.1f} at most; load "
        f"{os.getloadavg()[0]:.1f}" + (f"; {result.reason}" if result.reason else "")
    )
    for row in result.history:
        if row.ended_by is not None or not row.grasp_ok:
            console.print(f"  action {row.action}: {row.ended_by or 'grasped nothing'}")
    figures = {"actions": (float(result.actions), "1"), "true error": (result.true_rmse_m, "m")} | _of(found)
    return [
        BenchFigure(case=case, method="franka", metric=metric, value=value, low=None, high=None, unit=unit, n=1)
        for metric, (value, unit) in figures.items()
        if value is not None
    ]


def _of(found: Mirrored) -> dict[str, tuple[float, str]]:
    return {
        "twin rate": (found.twin_hz, "Hz"),
        "longest gap": (found.longest_gap_s, "s"),
        "driver rate": (found.driver_hz, "Hz"),
        "median joint difference": (found.median_rad, "rad"),
        "largest joint difference": (found.largest_rad, "rad"),
    }


if __name__ == "__main__":
    run_study(Args, run, __doc__)
