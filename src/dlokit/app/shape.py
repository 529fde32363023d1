"""`dlokit shape`: one task, from a start to a goal."""

import shlex
import sys
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dlokit.app.job import job_from_config
from dlokit.app.machine import machine_facts
from dlokit.app.report import write_report
from dlokit.app.terminal import RunDisplay
from dlokit.bench.judged_run import judged_run
from dlokit.system.config import RunConfig
from dlokit.system.run_folder import claim_run_folder, new_run_folder
from dlokit.types.flow import RunOutcome

RUNS = Path("runs")
EXIT_CONVERGED = 0
EXIT_ENDED_OTHERWISE = 3


@dataclass(frozen=True, kw_only=True)
class ShapeArgs:
    """Bring the DLO from a start to a goal shape by looking at it with the stereo camera.

    Examples:
      dlokit shape                                  from I to S, in lockstep
      dlokit shape --start random --seed 3          from a random start
      dlokit shape --goal curve.csv --fit-length    to a curve of your own
      dlokit shape --runtime live --goal interactive   drag the goal in the browser

    Exit code: 0 converged, 3 ended otherwise (the outcome says how), 2 bad input.
    """

    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """The run."""
    out: Path | None = None
    """Folder for result.json, config.toml, report.html and truth.npz; must be empty or not exist yet.
    [default: runs/<time>-<name>/]"""
    config: Path | None = None
    """A config.toml of an earlier run, as defaults for everything else on this command line."""


def run(args: ShapeArgs) -> int:
    """Run the task, write what it leaves, and say how it ended."""
    config = args.run
    job = job_from_config(config)
    folder = claim_run_folder(args.out) if args.out else new_run_folder(RUNS, job.name, datetime.now())
    console = Console()
    with RunDisplay(console, title=job.name, threshold_m=config.task.threshold_m) as display:
        record = judged_run(config, job, folder, display)
    record = replace(record, command=shlex.join(["dlokit", *sys.argv[1:]]), machine=machine_facts())
    report = write_report(folder, record)
    display.finish(record.result, report)
    return EXIT_CONVERGED if record.result.outcome is RunOutcome.CONVERGED else EXIT_ENDED_OTHERWISE
