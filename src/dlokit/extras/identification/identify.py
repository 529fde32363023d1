"""`dlokit identify`: estimate the parameters of a DLO from the actions of recorded runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated

import tyro
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import MaxNLocator
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import EXIT_OTHERWISE, InputError
from dlokit.extras.identification.measuring import Measures, measure
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import missing_part, read_recording
from dlokit.rod.believed import BelievedDlo, as_configured, with_belief
from dlokit.rod.posterior import Lesson, lessons
from dlokit.skills.model.experiences import experiences
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import read_toml, to_toml
from dlokit.types.dlo import DloBelief, LogNormal


def write_picture(path: Path, lessons: Sequence[Lesson]) -> None:
    """Plot the prediction errors and the belief to a PNG file."""
    figure = Drawing(figsize=(9.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _errors(left, lessons)
    _belief(right, lessons)
    figure.savefig(path, dpi=120)


def _errors(axes: Axes, lessons: Sequence[Lesson]) -> None:
    numbers = range(1, len(lessons) + 1)
    axes.plot(numbers, [lesson.configured_m * 1e3 for lesson in lessons], "o--", color="0.55", label="as configured")
    axes.plot(numbers, [lesson.learnt_m * 1e3 for lesson in lessons], "o-", color="C0", label="as learnt so far")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("action")
    axes.set_ylabel("prediction error, mm")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False)


def _belief(axes: Axes, lessons: Sequence[Lesson]) -> None:
    numbers = list(range(1, len(lessons) + 1))
    beliefs = [lesson.belief.elastic_m3 for lesson in lessons]
    low, high = zip(*(figure.interval() for figure in beliefs), strict=True)
    axes.fill_between(numbers, low, high, color="C0", alpha=0.2, linewidth=0.0, label="95 %")
    axes.plot(numbers, [figure.value for figure in beliefs], "o-", color="C0")
    for number, lesson in zip(numbers, lessons, strict=True):
        if lesson.belief.yield_curvature_1_m is not None:
            axes.annotate("set", (number, lesson.belief.elastic_m3.value), xytext=(0, 6), textcoords="offset points")
    axes.set_yscale("log")
    axes.set_xlabel("number of evaluated actions")
    axes.set_ylabel("EI / (μ w), m³")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False)


LEARNT_FILE = "identified.toml"
PICTURE_FILE = "identified.png"
TABLE_WIDTH = 100


@dataclass(frozen=True, kw_only=True)
class IdentifyArgs:
    """Estimate length, radius, stiffness, friction and plasticity of a DLO from its recorded runs.

    Length and radius are measured in the pictures. Each action is simulated with the planning rod for many values of
    the parameters, and compared with what the camera observed.

    Try
      dlokit identify runs/<run>
      dlokit identify runs/<run> runs/<other run of the same DLO>
      dlokit shape --config runs/<run>/identified.toml --goal S      a run with the estimated parameters

    Writes identified.toml, the configuration of the last run with the estimated parameters, and identified.png.
    Exit code: 0; 2 when a folder has no recorded run, or the runs contain no information; 3 when a recording is
    truncated or damaged, and the rest of it is used.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs of one DLO, in chronological order."""
    out: Annotated[Path | None, flag("DIR", "the last run's folder")] = None
    """Output folder."""


def run(args: IdentifyArgs) -> int:
    """Read the runs, estimate the parameters, print and write them."""
    if not args.runs:
        raise InputError("no run is given; give the folders of one or more runs, e.g. dlokit identify runs/<run>.")
    found = identify(args.runs)
    out = args.out or args.runs[-1]
    out.mkdir(parents=True, exist_ok=True)
    (out / LEARNT_FILE).write_text(to_toml(found.config), encoding="utf-8")
    console = Console()
    console = Console(width=max(console.width, TABLE_WIDTH))
    written = [out / LEARNT_FILE]
    if found.lessons:
        console.print(_actions(found.lessons))
        write_picture(out / PICTURE_FILE, found.lessons)
        written.append(out / PICTURE_FILE)
    console.print(_figures(found))
    lines = [f"written: {', '.join(map(str, written))}"]
    incomplete = {run: text for run in args.runs if (text := missing_part(run / FILE_NAME))}
    lines += [f"{run} is incomplete, the estimate uses the rest of it: {text}" for run, text in incomplete.items()]
    for line in lines:
        say(console, line)
    return EXIT_OTHERWISE if incomplete else 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Identified:
    """Results of the identification from the runs of one DLO."""

    belief: DloBelief
    """Length, radius, stiffness and friction, each with its uncertainty."""
    configured: RunConfig
    """The configuration of the last run."""
    config: RunConfig
    """That configuration with the identified figures."""
    lessons: tuple[Lesson, ...] = ()
    """Results of each action."""
    size: Measures | None = None
    """Length and radius as measured in the pictures; None if no picture shows the DLO."""

    @property
    def settings(self) -> dict[str, object]:
        """The identified figures as the argument `settings` of `dlokit.shape` and `dlokit.judge`."""
        return {"model": self.config.model}


def identify(runs: Sequence[Path | str | PathLike[str]]) -> Identified:
    """Estimate length, radius, stiffness and friction of a DLO from its runs, in their order.

    `runs` are their folders, or results of `dlokit.shape` and `dlokit.open_run`. Raises `InputError` if one is not a
    recorded run, or if the runs give no information about the DLO.
    """
    folders = [Path(one) for one in runs]
    if not folders:
        raise InputError("no run is named; give the folders of one or more runs of one DLO.")
    configured = read_toml(folders[-1] / CONFIG_FILE, RunConfig)
    size = measure(
        read_recording(folders[-1] / FILE_NAME), configured.perception, configured.model, configured.arm_model
    )
    model = configured.model if size is None else _with_size(configured.model, size)
    seen = [lesson for folder in folders for lesson in experiences(read_recording(folder / FILE_NAME))]
    found = tuple(lessons(model, seen, configured.scene.posts_world))
    if not found and size is None:
        raise InputError(
            f"{', '.join(map(str, folders))}: the DLO is in no picture, and no action held and moved it; "
            f"give a run that saw it."
        )
    belief = found[-1].belief if found else as_configured(model, stamp_ns=0)
    return Identified(
        belief=belief,
        configured=configured,
        config=replace(configured, model=with_belief(model, belief)),
        lessons=found,
        size=size,
    )


def _with_size(model: BelievedDlo, size: Measures) -> BelievedDlo:
    prior = as_configured(model, stamp_ns=0)
    length, radius = prior.length_m.fused_with(size.length_m), prior.radius_m.fused_with(size.radius_m)
    certain = replace(model.belief, length_log_sd=length.log_sd, radius_log_sd=radius.log_sd)
    return replace(model, length_m=length.value, radius_m=radius.value, belief=certain)


def _actions(found: Sequence[Lesson]) -> Table:
    table = Table(title="actions", caption="prediction error: RMSE of all nodes; as learnt: from the previous actions")
    for heading in ("action", "moved, mm", "as configured, mm", "as learnt, mm", "EI/(μ w), cm³", "plastic"):
        table.add_column(heading, justify="right", no_wrap=True)
    for lesson in found:
        low, high = lesson.belief.elastic_m3.interval()
        bend = lesson.belief.yield_curvature_1_m
        table.add_row(
            str(lesson.action),
            f"{lesson.moved_m * 1e3:.0f}",
            f"{lesson.configured_m * 1e3:.1f}",
            f"{lesson.learnt_m * 1e3:.1f}",
            f"{lesson.belief.elastic_m3.value * 1e6:.0f} ({low * 1e6:.0f} to {high * 1e6:.0f})",
            "no" if bend is None else f"above {bend:g} /m",
        )
    return table


def _figures(found: Identified) -> Table:
    belief, size = found.belief, found.size
    table = Table(title=f"the DLO, from {0 if size is None else size.looks} pictures and {belief.actions} actions")
    for heading in ("", "configured", "found", "95 % within"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    model = found.configured.model
    rows: tuple[tuple[str, float, LogNormal], ...] = (
        ("length, m", model.length_m, belief.length_m),
        ("radius, m", model.radius_m, belief.radius_m),
        ("bending stiffness EI, N·m²", model.bending_stiffness_n_m2, belief.bending_stiffness_n_m2),
        ("friction μ", model.friction, belief.friction),
        (
            "EI/(μ w), m³",
            model.bending_stiffness_n_m2 / (model.friction * belief.weight_n_m.value),
            belief.elastic_m3,
        ),
    )
    for name, before, figure in rows:
        low, high = figure.interval()
        table.add_row(name, f"{before:.3g}", f"{figure.value:.3g}", f"{low:.3g} to {high:.3g}")
    bend = belief.yield_curvature_1_m
    configured = model.yield_curvature_1_m
    table.add_row(
        "plastic above curvature, 1/m",
        "never" if configured is None else f"{configured:g}",
        "never" if bend is None else f"{bend:g}",
        "",
    )
    table.add_row("tightest arc that friction holds, cm", "", f"{belief.held_radius_m * 100:.1f}", "")
    return table


COMMAND = CliCommand(IdentifyArgs, run)
