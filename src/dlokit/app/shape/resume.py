"""`dlokit resume`: a live run whose decision process has crashed goes on in a new one."""

import shlex
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.shape.preflight import check_before_start, prepare
from dlokit.app.shape.shape import RUNS, display_of, exit_code, run_and_report
from dlokit.errors import InputError
from dlokit.evaluation.evaluator import left_nodes_world
from dlokit.evaluation.judged_run import CONFIG_FILE
from dlokit.system.config import RunConfig
from dlokit.system.processes.report import still_there
from dlokit.system.processes.running import running_systems
from dlokit.system.results.journal_file import read_journal
from dlokit.system.results.run_folder import claim_run_folder, new_run_folder
from dlokit.system.results.run_result import FILE_NAME, read_result
from dlokit.system.shaping import ShapeJob
from dlokit.system.toml_config import read_toml
from dlokit.types.flow import RunOutcome

RESUMABLE = (RunOutcome.FAILED, RunOutcome.CANCELLED)
"""Tasks that came to an end of their own have nothing left to do."""


ENDS_WITHIN_S = 15.0
"""The processes of a killed run end by themselves within seven seconds."""
LOOK_EVERY_S = 0.1


@dataclass(frozen=True, kw_only=True)
class ResumeArgs:
    """Go on with a live run that was killed, failed or was cancelled: same goal, what is left of the budget.

    The arm lets go of what it holds where it stands, goes up, and the DLO is looked for anew. What was learnt of grasps
    that led to nothing is kept. The run goes on in a folder of its own. A simulated cell lays its DLO where it lay
    last.
    Exit code as of `dlokit shape`.
    """

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder of the run to go on with."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-<name>/")] = None
    """Folder for the files of the new run; must be empty or not exist yet."""


def run(args: ResumeArgs) -> int:
    """Read what the run has left, and go on."""
    config, job = resumed_job(args.run)
    check_before_start(config)
    folder = claim_run_folder(args.out) if args.out else new_run_folder(RUNS, job.name, datetime.now())
    console = Console()
    prepare(console, config)
    assert job.resumed is not None
    console.print(
        f"{args.run}: {job.resumed.actions} actions done, {job.resumed.elapsed_s:.0f} s spent; going on in {folder}",
        highlight=False,
        soft_wrap=True,
    )
    again = shlex.join(["dlokit", "resume", str(args.run.absolute())])
    record, _ = run_and_report(config, job, folder, display_of(config, job, console), again)
    return exit_code(record)


def _wait_for_end(run_dir: Path) -> None:
    """The arm of a killed run may still brake, and its cell has not said yet how it leaves the DLO."""
    end_s = time.monotonic() + ENDS_WITHIN_S
    while left := still_there(run_dir):
        if time.monotonic() > end_s:
            raise InputError(f"{', '.join(left)} of {run_dir} do not end: kill them, then resume.")
        time.sleep(LOOK_EVERY_S)


def resumed_job(run_dir: Path) -> tuple[RunConfig, ShapeJob]:
    """Configuration and task of a run that can go on. Raises `InputError` where there is none."""
    if not run_dir.is_dir():
        raise InputError(f"{run_dir} is no folder: give the folder of a live run.")
    if any(system.folder == str(run_dir.resolve()) for system in running_systems(starting=True)):
        raise InputError(f"{run_dir} still runs: dlokit ps shows it, dlokit stop ends it.")
    _wait_for_end(run_dir)
    if (run_dir / FILE_NAME).exists() and (outcome := read_result(run_dir).outcome) not in RESUMABLE:
        raise InputError(f"{run_dir} has ended as {outcome.value}: there is nothing to go on with.")
    journal = read_journal(run_dir)
    config = read_toml(run_dir / CONFIG_FILE, RunConfig)
    job = ShapeJob(
        name=f"to {journal.request.name.rpartition('/')[2]}, resumed",
        start_nodes_world=left_nodes_world(run_dir),
        request=journal.request,
        resumed=journal,
    )
    return config, job


COMMAND = CliCommand(ResumeArgs, run)
