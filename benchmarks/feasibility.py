"""How often verdicts on goals are right: goals of four kinds, and the cell's physics as the judge.

    python benchmarks/feasibility.py                                    # three seeds, six DLOs
    python benchmarks/feasibility.py --seeds 8 --jobs 2 --json verdicts.json
    python benchmarks/feasibility.py --goals goals.npy --dlos soft-rope --seeds 1

Each seed makes up four goals and draws a cell for each DLO. The verdict on each goal is compared with what the DLO of
the cell does when it is laid there and released; nothing is planned and nothing is rendered. Where the DLO does not
stay, shapes near the goal are tried. Every goal is judged at three levels of knowledge: length and radius known,
nominal figures known, and beliefs drawn around the truth. docs/reference/bench-feasibility.md says how each is drawn.
"""

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from dlokit.errors import ConfigError, ShapeError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import success_rate, without_interval
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Standing
from parts.command import check_json, run_study, write_figures
from parts.feasibility_beliefs import Level
from parts.feasibility_cases import DEFAULT_DLOS, FeasibilityCase, Judged, bench_dlo, judge_cases
from parts.feasibility_releases import Happened

ALL = "all"
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
        for one in found:
            if one.case == ALL and one.method == level.value:
                console.print(f"  {_line(one)}", highlight=False)
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


def _line(one: BenchFigure) -> str:
    if one.unit == "s":
        return f"{one.metric}: {one.value:.2f} s"
    assert one.low is not None
    assert one.high is not None
    hits = round(one.value * one.n)
    return f"{one.metric}: {hits} of {one.n} ({one.low:.0%} to {one.high:.0%})"


@dataclass(frozen=True, kw_only=True)
class Args:
    """Compare verdicts on goals with what the cell's DLO does, laid there and released."""

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
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Judge, release, print; exit code 0. Ctrl-C prints what was done until then."""
    todo = _cases(args)
    console = Console()
    rows = _run(todo, args.jobs, console)
    print_results(rows, console)
    settings = {
        "seeds": list(range(args.first_seed, args.first_seed + args.seeds)),
        "dlos": list(args.dlos),
        "goals": None if args.goals is None else args.goals.name,
        "threshold_m": args.threshold_m,
    }
    write_figures(args.json, "feasibility", figures(rows), settings, console)
    return 0


def _cases(args: Args) -> list[FeasibilityCase]:
    """What is to be done; whatever is wrong with it is told before anything runs."""
    if not args.threshold_m > 0.0:
        raise ConfigError(f"--threshold-m is {args.threshold_m}; it must be a number above 0.")
    if args.seeds < 1 or args.jobs < 1 or args.first_seed < 0:
        raise ConfigError(
            f"--seeds {args.seeds}, --jobs {args.jobs}, --first-seed {args.first_seed}: at least 1, 1 and 0 are needed."
        )
    check_json(args.json)
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


def figures(rows: Sequence[Judged]) -> list[BenchFigure]:
    """For all DLOs, then for each, at each level of knowledge."""
    found: list[BenchFigure] = []
    for dlo in (ALL, *dict.fromkeys(row.dlo for row in rows)):
        for level in Level:
            of = [row for row in rows if row.level is level and dlo in (ALL, row.dlo)]
            found += _rates(dlo, level, of)
            if dlo == ALL:
                found += _seconds(level, of)
    return found


def is_right(row: Judged) -> bool:
    """Whether *holds* stayed, or *infeasible* was not reached; *doubtful* is never wrong."""
    match row.standing:
        case Standing.HOLDS:
            return row.happened is Happened.STAYED
        case Standing.INFEASIBLE:
            return row.happened is Happened.MISSED
        case Standing.DOUBTFUL:
            return True


def _rates(dlo: str, level: Level, rows: Sequence[Judged]) -> list[BenchFigure]:
    found: list[BenchFigure] = []
    for standing in Standing:
        said = [row for row in rows if row.standing is standing]
        if standing is not Standing.DOUBTFUL:
            found += _rate(dlo, level, f"{standing.value} is right", [is_right(row) for row in said])
        found += _rate(dlo, level, f"said {standing.value}", [row.standing is standing for row in rows])
    stayed = [row.standing is Standing.HOLDS for row in rows if row.happened is Happened.STAYED]
    missed = [row.standing is Standing.INFEASIBLE for row in rows if row.happened is Happened.MISSED]
    return [
        *found,
        *_rate(dlo, level, "of goals that stay, said holds", stayed),
        *_rate(dlo, level, "of goals missed, said infeasible", missed),
    ]


def _rate(dlo: str, level: Level, metric: str, hits: Sequence[bool]) -> list[BenchFigure]:
    """A share with its Clopper-Pearson interval; none of nothing."""
    if not hits:
        return []
    return [figure(dlo, level.value, metric, success_rate(sum(hits), len(hits)), "")]


def _seconds(level: Level, rows: Sequence[Judged]) -> list[BenchFigure]:
    if not rows:
        return []
    seconds = np.array([row.verdict_s for row in rows])
    values = {"median": np.median(seconds), "95th percentile": np.percentile(seconds, 95.0), "largest": seconds.max()}
    return [
        figure(
            ALL,
            level.value,
            f"processor time of a verdict, {name}",
            without_interval(float(value), len(rows)),
            "s",
        )
        for name, value in values.items()
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
