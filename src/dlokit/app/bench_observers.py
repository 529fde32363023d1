"""`dlokit bench observers`: every observer and the published peers on the same clouds."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from dlokit.app.machine import machine_facts
from dlokit.bench.observers.cases import CASES, TUNING_SEED, external_cases
from dlokit.bench.observers.external import unread_arrays
from dlokit.bench.observers.methods import choose, default_name
from dlokit.bench.observers.metrics import METRICS
from dlokit.bench.observers.report import case_table, draw, figures, methods_of, metric_table, observers_json
from dlokit.bench.observers.runner import Plan, Trial, run_plan
from dlokit.bench.report import Figure
from dlokit.errors import ConfigError, InputError
from dlokit.system.run_folder import claim_run_folder, new_run_folder

FULL_SEEDS, FULL_FRAMES = 10, 100
QUICK_SEEDS, QUICK_FRAMES = 2, 40


@dataclass(frozen=True, kw_only=True)
class ObserversArgs:
    """Compare observers on simulated and recorded sequences whose nodes are known.

    From a base case (30 % hidden in the middle, 2 mm noise, 5 % outliers, full speed) one factor is changed at a
    time. Prints tables with 95 % intervals over sequences and draws one picture a metric. Ctrl-C keeps what is done.
    """

    quick: bool = False
    """Fewer seeds and shorter sequences: about three minutes, for a first look."""
    seeds: int | None = None
    """Seeds 0 to K-1 of each case. [default: 10; 2 with --quick]"""
    frames: int | None = None
    """Frames of each sequence at most. [default: 100, which are 4 s; 40 with --quick; all of a --sequence]"""
    sequence: tuple[Path, ...] = ()
    """External sequences (.npz) in place of the simulated ones."""
    methods: str = ""
    """Observers and peers to run, e.g. anchored,cpd,pycpd. [default: all that are installed]"""
    json: Path | None = None
    """Also write every figure to this file."""
    out: Path | None = None
    """Folder for the pictures. [default: runs/<time>-bench-observers/]"""


def run_observers(args: ObserversArgs) -> int:
    """Run the comparison; exit code 0 also when it was ended early, with what was done."""
    plan, left_out = _plan(args)
    _check_writable(args.json)
    console = Console()
    for reason in left_out:
        console.print(f"left out: {reason}", highlight=False, soft_wrap=True, markup=False)
    for file in args.sequence:
        if unread := unread_arrays(file):
            console.print(f"{file}: not read: {', '.join(unread)}", highlight=False, soft_wrap=True, markup=False)
    folder = claim_run_folder(args.out) if args.out else new_run_folder(Path("runs"), "bench-observers", datetime.now())
    trials = _trials(plan, console)
    if not trials:
        console.print("ended before anything was done")
        return 0
    rows = figures(trials)
    _print(rows, console)
    pictures = draw(rows, folder)
    if args.json is not None:
        args.json.write_bytes(observers_json(rows, machine_facts(), plan))
        console.print(f"figures: {args.json}")
    console.print(f"pictures: {len(pictures)} in {folder}")
    return 0


def _plan(args: ObserversArgs) -> tuple[Plan, tuple[str, ...]]:
    seeds = args.seeds if args.seeds is not None else (QUICK_SEEDS if args.quick else FULL_SEEDS)
    frames = args.frames if args.frames is not None else (QUICK_FRAMES if args.quick else FULL_FRAMES)
    if not 1 <= seeds <= TUNING_SEED or frames < 2:
        raise ConfigError(
            f"--seeds {seeds} and --frames {frames}: needed are 1 to {TUNING_SEED} seeds (those above are for tuning) "
            "and at least 2 frames."
        )
    choice = choose(tuple(name.strip() for name in args.methods.split(",") if name.strip()))
    cases = external_cases(args.sequence) if args.sequence else CASES
    whole = bool(args.sequence) and args.frames is None and not args.quick
    plan = Plan(cases=cases, methods=choice.methods, seeds=seeds, frames=None if whole else frames)
    return plan, choice.left_out


def _check_writable(path: Path | None) -> None:
    """An hour's work must not end at a folder that does not exist."""
    if path is not None and not path.resolve().parent.is_dir():
        raise InputError(f"--json {path}: there is no folder {path.resolve().parent}; create it or name another.")


def _trials(plan: Plan, console: Console) -> list[Trial]:
    trials: list[Trial] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("observers", total=plan.trials)
        try:
            for trial in run_plan(plan):
                trials.append(trial)
                progress.update(bar, advance=1, description=f"{trial.case}, seed {trial.seed}, {trial.method}")
                if not console.is_terminal and len(trials) % len(plan.methods) == 0:
                    # Nothing moves in a log: a line a case and seed shows that it goes on.
                    console.print(f"{len(trials)} of {plan.trials}: {trial.case}, seed {trial.seed}", highlight=False)
        except KeyboardInterrupt:
            console.print(f"ended early: {len(trials)} of {plan.trials} trials are done; figures are of these")
    return trials


def _print(rows: Sequence[Figure], console: Console) -> None:
    methods = methods_of(rows)
    first = rows[0].case
    tables = [
        _table(f"node error, {METRICS[0].shown}", "case", methods, list(case_table(rows, METRICS[0]))),
        _table(f"case {first!r}, every metric", "metric", methods, list(metric_table(rows, first))),
    ]
    # A table that folds its figures cannot be read: a narrow or unknown width is overruled.
    wide = Console(width=max(console.width, 30 + 24 * len(methods)))
    for table in tables:
        wide.print(table)
    console.print(f"default observer: {default_name()}; times are processor time a frame", highlight=False)


def _table(title: str, first: str, methods: Sequence[str], lines: Sequence[tuple[str, ...]]) -> Table:
    table = Table(title=title, caption="mean over sequences (95 % interval)")
    table.add_column(first, no_wrap=True)
    for method in methods:
        table.add_column(method, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(*line)
    return table
