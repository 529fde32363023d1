"""`dlokit bench feasibility`: verdicts on goals against what the cell does."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.bench.feasibility.beliefs import Level
from dlokit.bench.feasibility.cases import DEFAULT_DLOS, FeasibilityCase, Judged, bench_dlo, judge_cases
from dlokit.bench.feasibility.figures import ALL, figures, is_right
from dlokit.bench.feasibility.releases import Happened
from dlokit.bench.report import BenchFigure, bench_json
from dlokit.errors import ConfigError, InputError, ShapeError
from dlokit.system.results.run_record import machine_facts
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Standing

_KNOWN = {
    Level.RULER: "length and radius told, the rest as shipped",
    Level.TOLD: "nominal figures told, off as the shipped ones are; and whether it takes a set",
    Level.LEARNT: "beliefs drawn around the truth: EI / (μ w) to 12 %, yield to 20 % (1 sd)",
}


def print_results(rows: Sequence[Judged], console: Console) -> None:
    """For each level of knowledge what was said against what happened; then rates, times and every wrong verdict."""
    found = figures(rows)
    for level in Level:
        of = [row for row in rows if row.level is level]
        if not of:
            continue
        console.print(f"[bold]{level.value}[/]: {_KNOWN[level]}", highlight=False, soft_wrap=True)
        console.print(_table(of))
        for figure in found:
            if figure.case == ALL and figure.method == level.value:
                console.print(f"  {_line(figure)}", highlight=False)
    for row in rows:
        if not is_right(row):
            console.print(
                f"wrong: {row.dlo}, {row.goal}, {row.level.value}: said {row.standing.value}, "
                f"{row.happened.value}; sprang back {row.true_rmse_m * 1e3:.1f} mm, "
                f"at best {row.best_rmse_m * 1e3:.1f} mm",
                highlight=False,
                soft_wrap=True,
            )


def _table(rows: Sequence[Judged]) -> Table:
    counts = Counter((row.dlo, row.standing, row.happened) for row in rows)
    table = Table(caption="goals: stayed / reached by another shape / missed")
    for heading in ("", *(standing.value for standing in Standing)):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for dlo in dict.fromkeys(row.dlo for row in rows):
        cells = (" / ".join(str(counts[dlo, said, what]) for what in Happened) for said in Standing)
        table.add_row(dlo, *cells)
    return table


def _line(figure: BenchFigure) -> str:
    if figure.unit == "s":
        return f"{figure.metric}: {figure.value:.2f} s"
    assert figure.low is not None
    assert figure.high is not None
    hits = round(figure.value * figure.n)
    return f"{figure.metric}: {hits} of {figure.n} ({figure.low:.0%} to {figure.high:.0%})"


@dataclass(frozen=True, kw_only=True)
class FeasibilityArgs:
    """Compare verdicts on goals with what the cell's DLO does, laid there and released; nobody plans, nothing is drawn.

    Each seed makes four goals up and draws a cell for each DLO. A goal where the DLO does not stay is tried again by
    shapes near it. Every goal is judged three times: with length and radius told, with nominal figures told, and with
    beliefs drawn around the truth.
    """

    seeds: int = 3
    """Seeds F to F + K - 1."""
    first_seed: int = 0
    """F: settings are tuned on seeds from 1000 on, and reported on those from 0 on."""
    goals: Path | None = None
    """A .npy file (G, K, 3) of goals [m] in the place of made-up ones, scaled to the DLO."""
    dlos: tuple[str, ...] = DEFAULT_DLOS
    """Which DLOs: presets, `firm_rope` and `stiff_rope`."""
    threshold_m: float = 0.012
    """RMSE below which a goal counts as reached [m]."""
    jobs: int = 1
    """Cases side by side, a process each."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write every figure to this file."""


def run_feasibility(args: FeasibilityArgs) -> int:
    """Judge, release, print; exit code 0. Ctrl-C prints what was done until then."""
    todo = _cases(args)
    console = Console()
    rows = _run(todo, args.jobs, console)
    print_results(rows, console)
    if args.json is not None:
        settings = {
            "seeds": list(range(args.first_seed, args.first_seed + args.seeds)),
            "dlos": list(args.dlos),
            "goals": None if args.goals is None else args.goals.name,
            "threshold_m": args.threshold_m,
        }
        args.json.write_bytes(bench_json("feasibility", figures(rows), machine_facts(), settings))
        console.print(f"figures: {args.json}", soft_wrap=True)
    return 0


def _cases(args: FeasibilityArgs) -> list[FeasibilityCase]:
    """What is to be done; whatever is wrong with it is told before anything runs."""
    if not args.threshold_m > 0.0:
        raise ConfigError(f"--threshold-m is {args.threshold_m}; it must be a number above 0.")
    if args.seeds < 1 or args.jobs < 1 or args.first_seed < 0:
        raise ConfigError(
            f"--seeds {args.seeds}, --jobs {args.jobs}, --first-seed {args.first_seed}: at least 1, 1 and 0 are needed."
        )
    if args.json is not None and not args.json.resolve().parent.is_dir():
        raise InputError(f"--json {args.json}: there is no folder {args.json.resolve().parent}; create it first.")
    dlos, curves = [bench_dlo(name) for name in args.dlos], _curves(args.goals)
    return [
        FeasibilityCase(dlo=dlo, seed=seed, threshold_m=args.threshold_m, curves=curves)
        for seed in range(args.first_seed, args.first_seed + args.seeds)
        for dlo in dlos
    ]


def _run(todo: Sequence[FeasibilityCase], jobs: int, console: Console) -> list[Judged]:
    done: dict[int, list[Judged]] = {}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("feasibility", total=len(todo))
        try:
            for at, judged in judge_cases(todo, jobs):
                done[at] = judged
                progress.advance(bar)
                console.print(
                    f"{todo[at].dlo.name}, seed {todo[at].seed}: {_summary(judged)}", highlight=False, soft_wrap=True
                )
        except KeyboardInterrupt:
            print_results(_in_order(done), console)
            console.print(f"interrupted: these are {len(done)} of {len(todo)} cases; no file was written.")
            raise
    return _in_order(done)


def _in_order(done: Mapping[int, list[Judged]]) -> list[Judged]:
    return [row for at in sorted(done) for row in done[at]]


def _summary(judged: Sequence[Judged]) -> str:
    happened = dict.fromkeys((row.goal, row.happened.value) for row in judged)
    return ", ".join(f"{goal} {what}" for goal, what in happened)


def _curves(path: Path | None) -> Mapping[str, Float64Array]:
    if path is None:
        return {}
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise ShapeError(f"Goals {path} cannot be read ({error}); give a .npy file of (G, K, 3) points [m].") from error
    if array.ndim != 3 or array.shape[2] != 3 or array.shape[1] < 2:
        raise ShapeError(f"Goals {path} are {array.shape}; they must be (G, K, 3) points [m] with K of 2 or more.")
    return {f"{path.name}:{index}": np.asarray(curve, dtype=np.float64) for index, curve in enumerate(array)}


COMMAND = CliCommand(FeasibilityArgs, run_feasibility)
