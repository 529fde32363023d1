"""`dlokit bench observers`: compare all observers and published methods on the same clouds."""

import itertools
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag, value_of
from dlokit.app.console import progress_bar, say
from dlokit.errors import EXIT_FAULT, EXIT_INTERRUPTED, ConfigError, MachineError
from dlokit.extras.bench.observers import iterations
from dlokit.extras.bench.observers.cases import CASES, TUNING_SEED, external_cases
from dlokit.extras.bench.observers.conditions import long_enough
from dlokit.extras.bench.observers.figures import ALL_CASES, HALF, Bar, Compared, bars, compare, figures
from dlokit.extras.bench.observers.methods import choose, default_name
from dlokit.extras.bench.observers.metrics import METRICS, Metric
from dlokit.extras.bench.observers.pictures import PictureSettings
from dlokit.extras.bench.observers.report import (
    by_key,
    case_table,
    draw,
    is_shown,
    methods_of,
    metric_table,
    observers_json,
    shown,
)
from dlokit.extras.bench.observers.runner import BenchPlan, Estimate, Trial, TrialStage, in_a_worker, run_in_workers
from dlokit.extras.bench.observers.sequence import unread_arrays
from dlokit.extras.bench.observers.simulated import RATE_HZ
from dlokit.extras.bench.report import BenchFigure, check_json
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.config import SEGMENTATIONS, AnySegmentation
from dlokit.system.config import one_of
from dlokit.system.results.run_folder import run_folder
from dlokit.system.results.run_result import machine_facts

_METRIC = {metric.name: metric for metric in METRICS}


def print_figures(rows: Sequence[BenchFigure], console: Console, *, comparable: bool) -> None:
    """Print the node errors of every case, all metrics of the first case, and how well health predicts the error."""
    methods = methods_of(rows)
    first, main = rows[0].case, next(metric for metric in METRICS if is_shown(metric, rows))
    tables = [_table(f"case {first!r}, every metric", "metric", methods, list(metric_table(rows, first)))]
    if any(row.case != first for row in rows):  # of a single case it would be a row of the table above
        tables.insert(0, _table(f"{main.name}, {main.shown}", "case", methods, list(case_table(rows, main))))
    if over_all := list(metric_table(rows, ALL_CASES)):
        tables.append(_table("all cases, health as a predictor of the error", "metric", methods, over_all))
    # Wrapped figures are unreadable, so the width of a narrow or unknown terminal is ignored.
    wide = Console(width=max(console.width, 34 + 24 * len(methods)), file=console.file, quiet=console.quiet)
    for table in tables:
        wide.print(table)
    times = "times are processor time per frame, one thread"
    if not comparable:
        times += "; NOT comparable, because processes ran in parallel"
    say(console, f"default observer: {default_name()}; {times}")


def print_summary(rows: Sequence[BenchFigure], compared: Sequence[Compared], plan: BenchPlan, console: Console) -> None:
    """Compare the default observer, without pins, with the best published method and with the bars."""
    wide = Console(width=max(console.width, 100), file=console.file, quiet=console.quiet)
    if compared:
        table = Table(title=f"{default_name()} against the best peer, node error", caption=f"bar: at most {HALF}")
        for heading in ("case", f"{default_name()} mm", "best peer mm", "peer", "ratio (95 %)", ""):
            table.add_column(heading, no_wrap=True, justify="left" if heading in ("case", "peer", "") else "right")
        for one in compared:
            low, high = one.figure.low, one.figure.high
            interval = "" if low is None or high is None else f" ({low:.2f} to {high:.2f})"
            verdict = ("met" if one.met else "MISSED") if one.has_bar else "no bar"
            ratio = f"{one.figure.value:.2f}{interval}"
            table.add_row(one.case, f"{one.own_m * 1e3:.1f}", f"{one.peer_m * 1e3:.1f}", one.peer, ratio, verdict)
        wide.print(table)
    lines = [line for bar in bars(plan.cases) if (line := _bar_line(bar, rows)) is not None]
    if lines:
        table = Table(title=f"bars, default observer {default_name()}")
        for heading in ("case", "metric", "figure", "bar", ""):
            table.add_column(heading, no_wrap=True, justify="right" if heading in ("figure", "bar") else "left")
        for line in lines:
            table.add_row(*line)
        wide.print(table)


def _bar_line(bar: Bar, rows: Sequence[BenchFigure]) -> tuple[str, ...] | None:
    row = by_key(rows).get((bar.case, bar.method or default_name(), bar.metric))
    if row is None:
        return None
    metric = _METRIC.get(bar.metric) or Metric(name=bar.metric, unit=row.unit, factor=1.0, shown="")
    limit = f"{'≥' if bar.is_least else '≤'} {shown(bar.most, metric)} {metric.shown}".rstrip()
    what = bar.metric if bar.method is None else f"{bar.metric}, {bar.method}"
    return bar.case, what, shown(row.value, metric), limit, "met" if bar.met(row.value) else "MISSED"


def _table(title: str, first: str, methods: Sequence[str], lines: Sequence[tuple[str, ...]]) -> Table:
    table = Table(title=title, caption="mean over sequences (95 % interval)")
    table.add_column(first, no_wrap=True)
    for method in methods:
        table.add_column(method, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    return table


FULL_SEEDS, FULL_FRAMES = 10, 100
QUICK_SEEDS, QUICK_FRAMES = 2, 50
_LOG_EVERY_S = 30.0


@dataclass(frozen=True, kw_only=True)
class ObserversArgs:
    """Compare observers on simulated and recorded sequences whose nodes are known.

    The base case has 30 % of the DLO hidden in the middle, 2 mm noise, 5 % outliers and full speed; each other case
    changes one factor. Prints tables with 95 % intervals over sequences, and draws one plot per metric. Ctrl-C keeps
    the finished trials; the exit code is then 130.

    Try
      dlokit bench observers --quick --methods mine,map --cases base "hidden 50 %"   some minutes
      dlokit bench observers --sequence cable.npz --methods mine,map                 recorded clouds
    """

    quick: bool = False
    """Fewer seeds and shorter sequences; takes a few minutes."""
    seeds: Annotated[int | None, flag("INT", "10; 2 with --quick")] = None
    """Use seeds 0 to K-1 for each case."""
    frames: Annotated[
        int | None,
        flag("INT", "100, which are 4 s; 50 with --quick; all of a --sequence"),
    ] = None
    """Maximum number of frames of each sequence."""
    sequence: tyro.conf.UseAppendAction[tuple[tuple[Path, ...], ...]] = ()
    """External sequences instead of the simulated ones; takes one or more files and can be repeated: .npz, or
    recorded pictures, as a bag of ROS (.bag, .mcap, .db3, a folder), whose topics --camera.colour and so on name."""
    cases: tuple[str, ...] = ()
    """Simulated cases to run, e.g. base "hidden 50 %"; all by default. A name that does not exist is refused with the
    list."""
    methods: Annotated[str, flag("NAMES", "all that are installed")] = ""
    """Observers and published methods to run, e.g. anchored,cpd,pycpd. Those of other packages come first."""
    bars: bool = False
    """Also compare dlokit's default observer with the best published method and with the limits of a release."""
    jobs: int = 1
    """Number of cases to run in parallel, each in its own process. With more than one, times are not comparable."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write all figures to this JSON file."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-bench-observers/")] = None
    """Folder for the plots."""
    segmentation: Annotated[str | None, one_of(SEGMENTATIONS, BrightnessConfig.name)] = None
    """How DLO pixels are found in recorded pictures, as in `dlokit track`."""
    camera_settings: Annotated[RecordedCameraConfig, tyro.conf.arg(name="camera")] = field(
        default_factory=RecordedCameraConfig
    )
    """Topics of a bag; its path is that of the sequence."""
    segmentation_settings: Annotated[AnySegmentation, tyro.conf.arg(name="segmentation")] = field(
        default_factory=BrightnessConfig
    )
    """Settings of the segmentation."""


def _defaults(arguments: Sequence[str]) -> ObserversArgs:
    """The settings of the segmentation that the command line names."""
    if (name := value_of(arguments, "--segmentation")) is None:
        return ObserversArgs()
    return ObserversArgs(segmentation_settings=SEGMENTATIONS.named(name, "--segmentation")())


def run_observers(args: ObserversArgs) -> int:
    """Run the comparison, and report the finished trials, also after Ctrl-C."""
    _, code = compare_observers(args, Console(), tables=True)
    return code


@dataclass(frozen=True, kw_only=True, eq=False)
class ObserverComparison:
    """The result of `dlokit.bench.observers`; `print` shows the tables."""

    figures: tuple[BenchFigure, ...]
    """Every figure with its 95 % interval: case, method, metric, value, low, high, unit, n."""
    folder: Path
    """Folder with a plot for each metric."""
    pictures: tuple[Path, ...]
    times_comparable: bool
    """Whether one process ran at a time."""

    def __str__(self) -> str:
        if not self.figures:
            return "no trial was finished"
        text = StringIO()
        print_figures(self.figures, Console(file=text), comparable=self.times_comparable)
        return text.getvalue().rstrip()

    def __repr__(self) -> str:
        return f"<ObserverComparison: {len(self.figures)} figures, {self.folder}>"


def compare_observers(args: ObserversArgs, console: Console, *, tables: bool = False) -> tuple[ObserverComparison, int]:
    """Run the comparison, and print its tables if wanted; after Ctrl-C those of the finished trials.

    The exit code is not 0 if trials are missing. Raises `InputError` before the first trial.
    """
    plan, omitted = _plan(args)
    check_json(args.json)
    for reason in omitted:
        say(console, f"omitted: {reason}")
    folder = run_folder(args.out, "bench-observers")
    # One iteration of CPD, of dlokit and of the packages, is timed when all methods are compared.
    times = in_a_worker(iterations.measure) if args.bars and not args.sequence and not args.methods else []
    trials, code = _trials(plan, args.jobs, console)
    if not trials:
        console.print("interrupted before any trial was finished")
        return ObserverComparison(figures=(), folder=folder, pictures=(), times_comparable=args.jobs == 1), code
    rows, apart = figures(trials), iterations.figures(times)
    compared = list(compare(trials, plan.cases))
    if args.json is not None:
        all_rows = [*rows, *(one.figure for one in compared), *apart]
        args.json.write_bytes(observers_json(all_rows, machine_facts(), plan, jobs=args.jobs))
    if tables:
        print_figures(rows, console, comparable=args.jobs == 1)
    if times:
        console.print(iterations.table(times))
    if args.bars:
        print_summary([*rows, *apart], compared, plan, console)
    pictures = draw(rows, folder)
    if args.json is not None:
        console.print(f"figures: {args.json}")
    console.print(f"pictures: {len(pictures)} in {folder}")
    found = ObserverComparison(
        figures=tuple(rows), folder=folder, pictures=tuple(pictures), times_comparable=args.jobs == 1
    )
    return found, code


def _plan(args: ObserversArgs) -> tuple[BenchPlan, tuple[str, ...]]:
    seeds = args.seeds if args.seeds is not None else (QUICK_SEEDS if args.quick else FULL_SEEDS)
    frames = args.frames if args.frames is not None else (QUICK_FRAMES if args.quick else FULL_FRAMES)
    if not 1 <= seeds <= TUNING_SEED or frames < 2:
        raise ConfigError(
            f"--seeds {seeds} and --frames {frames}: 1 to {TUNING_SEED} seeds (higher ones are reserved for tuning) "
            "and at least 2 frames are needed."
        )
    if args.jobs < 1:
        raise ConfigError(f"--jobs is {args.jobs}; it must be 1 or greater.")
    choice = choose(tuple(name.strip() for name in args.methods.split(",") if name.strip()))
    names = [case.name for case in CASES]
    if unknown := [name for name in args.cases if name not in names]:
        quoted = ", ".join(map(repr, names))
        raise ConfigError(f"There is no case {', '.join(map(repr, unknown))}; choose from {quoted}.")
    if args.sequence:
        if args.cases:
            raise ConfigError("--cases are of simulated sequences; omit it, or omit --sequence.")
        whole = args.frames is None and not args.quick
        paths = tuple(dict.fromkeys(itertools.chain.from_iterable(args.sequence)))
        found = PictureSettings(camera=args.camera_settings, segmentation=args.segmentation_settings)
        cases = external_cases(paths, found)
        omitted = tuple(f"arrays of {path}: {', '.join(names)}" for path in paths if (names := unread_arrays(path)))
        # Without pins the pinned methods would be the others once more.
        methods = tuple(one for one in choice.methods if not one.pinned or any(case.pins for case in cases))
        plan = BenchPlan(cases=cases, methods=methods, seeds=seeds, frames=None if whole else frames)
        return plan, (*choice.omitted, *omitted)
    chosen = [case for case in CASES if case.name in args.cases] if args.cases else list(CASES)
    short = [case for case in chosen if not long_enough(case.conditions, frames, RATE_HZ)]
    too_few = f"{frames} frames are too few before and after the event; increase --frames"
    if len(short) == len(chosen):
        raise ConfigError(f"--cases {', '.join(repr(case.name) for case in short)}: {too_few}.")
    plan = BenchPlan(
        cases=tuple(case for case in chosen if case not in short), methods=choice.methods, seeds=seeds, frames=frames
    )
    return plan, (*choice.omitted, *(f"case {case.name!r}: {too_few}" for case in short))


def _trials(plan: BenchPlan, jobs: int, console: Console) -> tuple[list[Trial], int]:
    """Return the finished trials, and the exit code."""
    trials: list[Trial] = []
    with progress_bar(console) as progress, closing(run_in_workers(plan, jobs)) as said:
        bar = progress.add_task("observers", total=plan.trials)
        logged_s = time.monotonic()
        try:
            for item in said:
                if isinstance(item, Estimate):
                    say(console, _announced(item, plan, jobs))
                    continue
                if isinstance(item, Trial):
                    trials.append(item)
                progress.update(bar, completed=len(trials), description=_where(item))
                if not console.is_terminal and time.monotonic() - logged_s > _LOG_EVERY_S:
                    # A log shows no progress bar, so a line is printed from time to time.
                    logged_s = time.monotonic()
                    say(console, f"{len(trials)} of {plan.trials}: {_where(item)}")
        except KeyboardInterrupt:
            console.print(f"interrupted: {len(trials)} of {plan.trials} trials are finished; the figures are of these")
            return trials, EXIT_INTERRUPTED
        except MachineError as error:
            say(console, f"{error} The figures are of the {len(trials)} of {plan.trials} finished trials.")
            return trials, EXIT_FAULT
    return trials, 0


def _announced(estimate: Estimate, plan: BenchPlan, jobs: int) -> str:
    methods = "; ".join(method.name for method in plan.methods)  # a name may have a comma
    seconds = estimate.seconds / jobs
    takes = f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
    sequences = len(plan.seeded_cases)
    return f"about {takes}: {plan.trials} trials, {sequences} sequences for each of {methods}; Ctrl-C ends early"


def _where(item: Trial | TrialStage) -> str:
    where = f"{item.case}, seed {item.seed}, {item.method}"
    return where if isinstance(item, Trial) else f"{where}, frame {item.frame} of {item.frames}"


COMMAND = CliCommand(ObserversArgs, run_observers, _defaults)
