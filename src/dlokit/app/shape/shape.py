"""`dlokit shape`: run one task, from a start to a goal shape."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, cast

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, file_after, flag, value_of
from dlokit.app.console import prepare, say
from dlokit.app.shape.questions import TerminalOperator
from dlokit.app.shape.terminal import RunDisplay
from dlokit.errors import EXIT_FAULT, EXIT_OTHERWISE, ConfigError
from dlokit.evaluation.judged_run import judged_run, judged_task
from dlokit.recording.disk import Disk
from dlokit.system.config import BY_OPERATOR, CONFIG_FILE, INTERACTIVE, SEEN, RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import ShapeJob, job_from_config, with_absolute_files
from dlokit.system.request import SWITCHES, Choices, RunRequest
from dlokit.system.results.run_folder import run_folder
from dlokit.system.results.run_result import (
    GOAL_FILE_NAME,
    NEAREST_FILE_NAME,
    START_FILE_NAME,
    RunRecord,
    machine_facts,
)
from dlokit.system.signals import LastResort, interrupts_answered

_INVITATIONS = {
    INTERACTIVE: "Open it in a browser, set the goal (drag, draw, choose or show it), and press “Shape it”.",
    SEEN: "Open it in a browser. The shape that the camera sees is the goal: move the DLO, then press “Shape it”.",
}
STAYS = (
    "The run stays after its task: set the next goal on the page. “End run” on the page or Ctrl-C ends it; after "
    "dlokit stop it waits for dlokit enable and the next goal."
)


@dataclass(frozen=True, kw_only=True)
class ShapeOptions:
    """Options of `dlokit shape` that are not part of the configuration."""

    out: Annotated[Path | None, flag("DIR", "runs/<time>-<name>/")] = None
    """Folder for the run's files, empty or new; gets result.json, config.toml, report.html and truth.npz."""
    config: Annotated[Path | None, flag("FILE")] = None
    """Settings from a TOML file: all or some, e.g. `task.threshold_m = 0.01`. Every run writes all of its own to
    config.toml; a file may be any part of one. Flags of this command line override it."""
    stay: bool = False
    """Take goal after goal from the viewer's page. The run goes on after its task, until “End run” or Ctrl-C; `dlokit
    stop` ends the task only. A run whose goal is `interactive` or `seen` always does. Needs `--runtime live` and the
    viewer."""
    operator_confirms: bool = False
    """Start a real arm without questions. An operator has checked that the gripper is empty, the DLO in view and free,
    and the workspace clear, and has a hand on the emergency stop; the camera must see the DLO all the same."""


@dataclass(frozen=True, kw_only=True)
class ShapeArgs:
    """Move the DLO from a start shape to a goal shape, guided by a camera.

    Try
      dlokit shape --goal curve.csv --fit-length       to your own curve
      dlokit shape --runtime live --goal interactive   set goal after goal in the browser

    Before the arm moves, the model predicts whether the DLO keeps the goal shape after a release. `--infeasible`
    determines what to do with an infeasible goal.

    Ctrl-C brakes the arms, ends the system and writes the files, within 60 s at most; a second one says what a third
    costs, which ends the program at once.

    Exit code: 0 converged, or a dry run that found an action, 3 ended otherwise, 2 bad input, 1 the disk failed.
    """

    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """Configuration of the run."""
    options: Annotated[ShapeOptions, tyro.conf.arg(name="")] = field(default_factory=ShapeOptions)
    """Options that are not settings."""
    choices: Annotated[Choices, tyro.conf.arg(name="")] = field(default_factory=Choices)
    """Choices by name; `run` already contains them."""


def run(args: ShapeArgs) -> int:
    """Run the task, write its files, and print how it ended."""
    config = with_absolute_files(args.run)
    job = replace(job_from_config(config), stays=stays(config, asked=args.options.stay))
    confirms = args.options.operator_confirms
    check_before_start(config, operator_confirms=confirms)
    out = args.options.out
    folder = run_folder(out, job.name)
    console = Console()
    prepare(console, config)
    with display_of(config, job, folder, console, operator_confirms=confirms) as display:
        record = judged_run(config, job, folder, display)
    return exit_code(reported(record, job, folder, display, again_by_config(folder)))


def can_stay(config: RunConfig) -> bool:
    """Whether a run can take goals from the page after its task."""
    return config.runtime == "live" and not config.headless and not config.dry_run


def stays(config: RunConfig, *, asked: bool) -> bool:
    """Whether a run takes the next goal from the page after its task. Raises `ConfigError` if `asked` is impossible."""
    if asked and not can_stay(config):
        raise ConfigError(
            "--stay takes the next goals from the viewer's page of a live run: use --runtime live, without --headless "
            "and --dry-run."
        )
    return can_stay(config) and (asked or config.goal in BY_OPERATOR)


def again_by_config(folder: Path) -> str:
    """The command that repeats a run from its configuration.

    Not the typed command: its --out is now taken, and its file names may be relative to another folder.
    """
    return shlex.join(["dlokit", "shape", "--config", str((folder / CONFIG_FILE).absolute())])


def exit_code(record: RunRecord) -> int:
    """0 if the run converged, or was a complete dry run; 1 if its files are incomplete; 3 otherwise."""
    if record.unwritten:
        return EXIT_FAULT
    return 0 if record.result.outcome.is_success else EXIT_OTHERWISE


def display_of(
    config: RunConfig, job: ShapeJob, folder: Path, console: Console, *, operator_confirms: bool = False
) -> RunDisplay:
    """The display of a run in a terminal, where the operator confirms the start of a real arm."""
    return RunDisplay(
        console,
        title=job.name,
        threshold_m=config.task.threshold_m,
        invitation="\n".join(filter(None, (_INVITATIONS.get(config.goal, ""), STAYS if job.stays else ""))),
        operator=TerminalOperator(confirms=operator_confirms),
        keep=partial(_task_kept, config, folder),
        last_resort=LastResort(partial(say, console)),
        starts="its processes; on a busy machine up to a minute" if config.runtime == "live" else "",
        stays=job.stays,
    )


def reported(record: RunRecord, job: ShapeJob, folder: Path, display: RunDisplay, again: str) -> RunRecord:
    """Write the report of an ended run, and print its outcome; `again` is the command that repeats the run, if any."""
    with interrupts_answered(display.interrupted_again):
        record, report = _with_report(record, folder, again)
    nearest = folder / NEAREST_FILE_NAME
    if job.stays:
        display.closed(folder, report)
    else:
        display.finish(record.result, report, nearest if nearest.exists() else None)
    if record.unwritten:
        display.incomplete(folder, record.unwritten, again)
    return record


def _with_report(record: RunRecord, out: Path, again: str) -> tuple[RunRecord, Path | None]:
    """The record with the report's data, and the path of the report in `out`; None if it could not be written.

    `again` is the command that repeats the task; empty where only the calling program can.
    """
    record = replace(record, command=again, machine=machine_facts())
    from dlokit.app.report import page  # imports matplotlib, which the run does not need

    html, disk = page.report_html(record), Disk()
    kept = disk.written(page.FILE_NAME, lambda: page.write_report(out, html))
    return replace(record, unwritten={**record.unwritten, **disk.failures}), out / page.FILE_NAME if kept else None


def _task_kept(config: RunConfig, folder: Path, number: int, record: RunRecord) -> tuple[RunRecord, Path]:
    """Judge a task of a run that goes on and write its files; the judged record, and the folder of the files."""
    record, out = judged_task(config, record, folder, number)
    record, _ = _with_report(record, out, f"{again_by_config(folder)}{_of_task(out)}")
    return record, out


def _of_task(out: Path) -> str:
    """The options that repeat one task of a run: its goal, and the start of a later one, which was seen."""
    files = {"--start": out / START_FILE_NAME, "--goal": out / GOAL_FILE_NAME}
    options = [f" {flag} {shlex.quote(str(file.absolute()))}" for flag, file in files.items() if file.exists()]
    # What the camera saw is about as long as the DLO.
    return "".join((*options, " --fit-length" if files["--start"].exists() else ""))


def choices_in(arguments: Sequence[str]) -> Choices:
    """The choices by name in a command line; they are read first, because they change the other arguments' defaults."""
    named = {name: value_of(arguments, f"--{name}") for name in Choices.__annotations__ if name not in SWITCHES}
    return cast(Choices, {**named, **{name: f"--{name}" in arguments for name in SWITCHES}})


def _defaults(arguments: Sequence[str]) -> ShapeArgs:
    config = file_after("--config", arguments)
    run = RunRequest(config=config, choices=choices_in(arguments), prefix="--").configured()
    return ShapeArgs(run=run, options=ShapeOptions(config=config))


COMMAND = CliCommand(ShapeArgs, run, _defaults)
