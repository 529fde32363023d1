"""`dlokit resume`: continue a live run whose decision process has crashed."""

import shlex
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import prepare, say
from dlokit.app.shape.shape import display_of, exit_code, reported
from dlokit.errors import InputError
from dlokit.evaluation.evaluator import left_nodes_world
from dlokit.evaluation.judged_run import CONFIG_FILE, judged_run
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.job import ShapeJob
from dlokit.system.processes.report import unended_processes
from dlokit.system.processes.running import running_systems
from dlokit.system.results.run_folder import HIDDEN_START, read_journal, run_folder
from dlokit.system.results.run_result import FILE_NAME, read_result
from dlokit.types.flow import RunOutcome

RESUMABLE = (RunOutcome.FAILED, RunOutcome.CANCELLED)
"""Outcomes after which a run can be resumed; a run that was killed has no outcome, and can be resumed as well."""
ENDS_WITHIN_S = 15.0
"""Time within which the processes of a killed run end on their own [s], plus a margin."""
LOOK_EVERY_S = 0.1
"""Interval at which the processes are checked [s]."""


@dataclass(frozen=True, kw_only=True)
class ResumeArgs:
    """Resume a live run that was killed, failed or was cancelled, with the same goal and the remaining budget.

    The arm opens its gripper where it is and moves up, and the observer searches for the DLO again. The record of
    failed grasps is kept. The resumed run gets its own folder. A simulated cell places its DLO at its last position.
    The exit codes are those of `dlokit shape`.
    """

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Folder of the run to resume."""
    dry_run: bool = False
    """Look and plan the next action in software; no arm moves."""
    operator_confirms: bool = False
    """Start a real arm without questions: an operator has checked that its gripper holds nothing but the DLO, which it
    drops where it is, and that the workspace is clear, and has a hand on the emergency stop."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-<name>/")] = None
    """Folder for the files of the new run; it must be empty or not exist yet."""


def run(args: ResumeArgs) -> int:
    """Read the journal of the run, and continue the task."""
    config, job = resumed_job(args.run)
    config = replace(config, dry_run=args.dry_run)
    check_before_start(config, operator_confirms=args.operator_confirms)
    folder = run_folder(args.out, job.name)
    console = Console()
    prepare(console, config)
    assert job.resumed is not None
    done = f"{job.resumed.actions} actions done, {job.resumed.elapsed_s:.0f} s spent"
    say(console, f"{args.run}: {done}; continuing in {folder}")
    again = shlex.join(["dlokit", "resume", str(args.run.absolute())])
    with display_of(config, job, folder, console, operator_confirms=args.operator_confirms) as display:
        record = judged_run(config, job, folder, display)
    return exit_code(reported(record, job, folder, display, again))


def _wait_for_end(run_dir: Path) -> None:
    """Wait, because the arm of a killed run may still brake, and its cell may not have saved the state of the DLO."""
    end_s = time.monotonic() + ENDS_WITHIN_S
    while left := unended_processes(run_dir):
        if time.monotonic() > end_s:
            raise InputError(f"{', '.join(left)} of {run_dir} did not end: kill them, then resume.")
        time.sleep(LOOK_EVERY_S)


def resumed_job(run_dir: Path) -> tuple[RunConfig, ShapeJob]:
    """Configuration and task of a run that can be resumed. Raises `InputError` if it cannot."""
    if not run_dir.is_dir():
        raise InputError(f"{run_dir} is not a folder: give the folder of a live run.")
    if any(system.folder == str(run_dir.resolve()) for system in running_systems(starting=True)):
        raise InputError(f"{run_dir} is still running: dlokit ps lists it, dlokit stop ends its task.")
    _wait_for_end(run_dir)
    if (run_dir / FILE_NAME).exists() and (outcome := read_result(run_dir).outcome) not in RESUMABLE:
        raise InputError(f"{run_dir} has ended as {outcome.value}: there is nothing to resume.")
    journal = read_journal(run_dir)
    config = read_toml(run_dir / CONFIG_FILE, RunConfig)
    job = ShapeJob(
        name=f"to {journal.request.name.rpartition('/')[2]}, resumed",
        start_nodes_world=left_nodes_world(run_dir) if config.has_cell else HIDDEN_START,
        request=journal.request,
        resumed=journal,
    )
    return config, job


COMMAND = CliCommand(ResumeArgs, run)
