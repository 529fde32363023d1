"""`dlokit shape`: one task, from a start to a goal."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.shape.job import chosen_settings, config_file_of, job_from_config, with_absolute_files
from dlokit.app.shape.preflight import check_before_start, prepare
from dlokit.app.shape.terminal import RunDisplay
from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.errors import EXIT_OTHERWISE
from dlokit.evaluation.judged_run import judged_run
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.perception.segmentations import SEGMENTATIONS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.system.config import CONFIG_FILE, INTERACTIVE, RunConfig
from dlokit.system.results.run_folder import claim_run_folder, new_run_folder
from dlokit.system.results.run_record import RunRecord, machine_facts
from dlokit.system.results.run_result import NEAREST_FILE_NAME
from dlokit.system.shaping import ShapeJob
from dlokit.types.flow import RunOutcome

RUNS = Path("runs")
_DRAG = "Open it in a browser, drag the three frames to the goal you want, and press “Shape it”."

C = TypeVar("C", bound=NamedConfig)


AS_SHIPPED = RunConfig()


def _one_of(kind: StrategyKind[C], default: C) -> Any:
    """A flag that takes the name of an installed strategy, looked up when the command line is built."""
    return tyro.conf.arg(
        constructor_factory=kind.names,
        help_behavior_hint=f"(default: {default.name})",
    )


@dataclass(frozen=True, kw_only=True)
class ShapeChoices:
    """What `dlokit shape` takes beside the configuration itself."""

    out: Annotated[Path | None, flag("DIR", "runs/<time>-<name>/")] = None
    """Folder for the run's files, empty or not there yet; gets result.json, config.toml, report.html and truth.npz."""
    config: Annotated[Path | None, flag("FILE")] = None
    """Take the settings of an earlier run's config.toml; this command line goes before it."""
    dlo: Annotated[str | None, flag("PRESET", "soft_rope")] = None
    """What lies on the table: soft_rope, silicone_hose, wire_a, wire_b, wire_c, thin_wire or stiff_wire. The system's
    own model is told its length and radius, which a ruler tells, and nothing else."""
    physics: Annotated[str | None, flag("NAME", "chain for wires, else rod")] = None
    """How the DLO in the cell behaves: a rod springs back, a chain takes a set. The system's own model is a rod in any
    case."""
    randomised: bool = False
    """Draw friction, stiffness, light and more of the cell from the seed; also weight, curl, hand-eye error, tilt of
    the table, colour. `--cell.randomised friction light` draws these alone."""
    observer: Annotated[str | None, _one_of(OBSERVERS, AS_SHIPPED.observer.strategy)] = None
    """How nodes are found in a cloud: map, anchored, cpd, spr or som. The last three are the paper's; an installed
    package may add others. `--observer cpd --help observer` shows the settings of cpd."""
    segmentation: Annotated[str | None, _one_of(SEGMENTATIONS, AS_SHIPPED.perception.segmentation)] = None
    """Which pixels are DLO: by brightness (the paper's) or colour; an installed package may add others."""
    planner: Annotated[str | None, _one_of(PLANNERS, AS_SHIPPED.planning.strategy)] = None
    """How actions are chosen: rollout, farthest (the paper's), farthest-tangent; an installed package may add
    others."""


@dataclass(frozen=True, kw_only=True)
class ShapeArgs:
    """Bring the DLO from a start to a goal shape by looking at it with the stereo camera.

    Try
      dlokit shape                                     from I to S, in lockstep
      dlokit shape --start random --seed 3             from a random start
      dlokit shape --goal curve.csv --fit-length       to a curve of your own
      dlokit shape --goal curve.csv --infeasible project   or to the nearest shape that holds
      dlokit shape --runtime live --goal interactive   drag the goal in the browser

    Before the arm moves the goal is tried in the model: does the rope stay there when it is released? `--infeasible`
    says what to do with a goal that does not hold.

    Exit code: 0 converged, 3 ended otherwise (the outcome says how), 2 bad input.
    """

    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """The run."""
    choices: Annotated[ShapeChoices, tyro.conf.arg(name="")] = field(default_factory=ShapeChoices)
    """Files, and choices by name."""


def run(args: ShapeArgs) -> int:
    """Run the task, write what it leaves, and say how it ended."""
    config = with_absolute_files(args.run)
    job = job_from_config(config)
    check_before_start(config)
    out = args.choices.out
    folder = claim_run_folder(out) if out else new_run_folder(RUNS, job.name, datetime.now())
    console = Console()
    prepare(console, config)
    record, _ = run_and_report(config, job, folder, display_of(config, job, console), again_by_config(folder))
    return exit_code(record)


def again_by_config(folder: Path) -> str:
    """The command that repeats a run by its configuration.

    Not what was typed: its --out has been used, and its files may be named from another folder.
    """
    return shlex.join(["dlokit", "shape", "--config", str((folder / CONFIG_FILE).absolute())])


def exit_code(record: RunRecord) -> int:
    """0 where the run converged."""
    return 0 if record.result.outcome is RunOutcome.CONVERGED else EXIT_OTHERWISE


def display_of(config: RunConfig, job: ShapeJob, console: Console) -> RunDisplay:
    """The display of a run in a terminal."""
    invitation = _DRAG if config.goal == INTERACTIVE else ""
    return RunDisplay(console, title=job.name, threshold_m=config.task.threshold_m, invitation=invitation)


def run_and_report(
    config: RunConfig, job: ShapeJob, folder: Path, display: RunDisplay, again: str
) -> tuple[RunRecord, Path]:
    """Run a task, write what it leaves, and say how it ended; `again` is the command that repeats it.

    Returns what the runtime remembers of the run, and the path of its report.
    """
    with display:
        record = judged_run(config, job, folder, display)
    record = replace(record, command=again, machine=machine_facts())
    from dlokit.app.report.page import write_report  # draws with matplotlib, which nobody waits for before the run

    report = write_report(folder, record)
    nearest = folder / NEAREST_FILE_NAME
    display.finish(record.result, report, nearest if nearest.exists() else None)
    return record, report


def _defaults(arguments: Sequence[str]) -> ShapeArgs:
    config = config_file_of(arguments)
    return ShapeArgs(run=chosen_settings(arguments, config), choices=ShapeChoices(config=config))


COMMAND = CliCommand(ShapeArgs, run, _defaults)
