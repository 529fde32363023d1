"""`dlokit bench`: comparisons, printed as a table and written as JSON."""

import multiprocessing
import platform
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from dlokit.app.bench_feasibility import FeasibilityArgs, run_feasibility
from dlokit.app.bench_observers import ObserversArgs, run_observers
from dlokit.app.environment import prepare_environment
from dlokit.app.machine import machine_facts
from dlokit.bench.report import bench_json, figures, overview, spread, timing_figures
from dlokit.bench.shaping import PAPER_SUITE, Case, CaseResult, Method, cases, methods_of, run_case, with_method
from dlokit.bench.simulation import measure
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.run_folder import claim_run_folder, new_run_folder

TABLE_WIDTH = 160
SUITES = {"paper": PAPER_SUITE}


@dataclass(frozen=True, kw_only=True)
class ShapingArgs:
    """Run the paper's five experiments over several seeds, in lockstep, judged by the cell's hidden truth.

    Prints a table with 95 % intervals; every run leaves its files in its own folder.
    """

    suite: Literal["paper"] = "paper"
    """Which experiments: paper = I to S, S to I, I to I (moved by 15 cm, turned by 40°), random to I, random to S."""
    seeds: int = 5
    """Seeds 0 to K-1 of each experiment."""
    first_seed: int = 0
    """Seeds F to F+K-1 in place of 0 to K-1; what was tuned on some is reported on others."""
    planner: str = ""
    """Planners to compare on the same starts, e.g. farthest,rollout. [default: the configuration's]"""
    observer: str = ""
    """Observers to compare, each with every planner, e.g. map,cpd. [default: the configuration's]"""
    jobs: int = 1
    """Runs side by side, a process each."""
    json: Path | None = None
    """Also write every figure to this file."""
    out: Path | None = None
    """Folder for the runs. [default: runs/<time>-bench-shaping/]"""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=lambda: RunConfig(record=False))
    """Settings of every run; start, goal, seed and runtime are the bench's. Recorded only with `--record`."""


def run_shaping(args: ShapingArgs) -> int:
    """Run the suite; exit code 0 when every run ended, converged or not."""
    if args.seeds < 1 or args.jobs < 1 or args.first_seed < 0:
        raise ConfigError(
            f"--seeds {args.seeds} and --jobs {args.jobs} must be at least 1, "
            f"--first-seed {args.first_seed} at least 0."
        )
    console = Console()
    folder = claim_run_folder(args.out) if args.out else new_run_folder(Path("runs"), "bench-shaping", datetime.now())
    todo = list(cases(SUITES[args.suite], args.seeds, _methods(args), first_seed=args.first_seed))
    results: list[CaseResult] = []
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("shaping", total=len(todo))
        for done in _run_all(todo, args, folder):
            results.append(done)
            progress.advance(bar)
            console.print(_line(done), highlight=False, soft_wrap=True)
    results.sort(key=lambda done: todo.index(done.case))
    # A table that folds its figures cannot be read: a narrow or unknown width is overruled.
    Console(width=max(console.width, TABLE_WIDTH)).print(_table(results))
    if args.json is not None:
        args.json.write_bytes(bench_json("shaping", figures(results), machine_facts(), args.run))
        console.print(f"figures: {args.json}")
    console.print(f"runs: {folder}")
    return 0


def _methods(args: ShapingArgs) -> tuple[Method, ...]:
    """Who is compared; a name that is not known is told before anything runs."""
    methods = methods_of(args.run, _names(args.observer), _names(args.planner))
    for method in methods:
        with_method(args.run, method)
    return methods


def _names(listed: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in listed.split(",") if name.strip()))


def _run_all(todo: Sequence[Case], args: ShapingArgs, folder: Path) -> Iterator[CaseResult]:
    work = [(case, _config(case, args.run), folder / _folder_name(case)) for case in todo]
    if args.jobs == 1:
        for item in work:
            yield run_case(*item)
        return
    context = multiprocessing.get_context("spawn")  # a forked OpenGL context is not usable
    with ProcessPoolExecutor(args.jobs, mp_context=context, initializer=prepare_environment) as pool:
        for future in as_completed([pool.submit(run_case, *item) for item in work]):
            yield future.result()


def _folder_name(case: Case) -> str:
    return f"{case.experiment.name.replace(' ', '-')}-{case.seed}-{case.method.planner}-{case.method.observer}"


def _config(case: Case, config: RunConfig) -> RunConfig:
    return replace(
        with_method(config, case.method),
        start=case.experiment.start,
        goal=case.experiment.goal,
        seed=case.seed,
        runtime="lockstep",
        headless=True,
    )


def _line(done: CaseResult) -> str:
    case, result = done.case, done.result
    rmse = "-" if result.rmse_m is None else f"{result.rmse_m * 1e3:.1f} mm"
    true = "-" if result.true_rmse_m is None else f"{result.true_rmse_m * 1e3:.1f} mm"
    return (
        f"{case.experiment.name:12} seed {case.seed}  {case.method.name:14}  {result.outcome.value:10} "
        f"{result.actions:3d} actions  RMSE {rmse:>8}  true {true:>8}  "
        f"{result.sim_time_s:6.1f} s simulated in {result.wall_time_s:6.1f} s"
        + (f"  ({result.reason})" if result.reason else "")
    )


def _table(results: Sequence[CaseResult]) -> Table:
    table = Table(title=f"shaping on {platform.machine()}", caption="median (smallest to largest) over seeds")
    for heading in (
        "experiment",
        "planner, observer",
        "converged",
        "95 % interval",
        "actions",
        "RMSE mm",
        "true RMSE mm",
        "robot s",
        "pace",
    ):
        table.add_column(
            heading, justify="left" if heading in ("experiment", "planner, observer") else "right", no_wrap=True
        )
    for row in overview(results):
        table.add_row(*row)
    return table


@dataclass(frozen=True, kw_only=True)
class SimulationArgs:
    """Measure where the time of a lockstep run goes: physics, rendering, perception, observer, model."""

    repeats: int = 20
    """Repetitions of each part."""
    json: Path | None = None
    """Also write every figure to this file."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """Settings of the parts."""


def run_simulation(args: SimulationArgs) -> int:
    """Measure and print; exit code 0."""
    if args.repeats < 1:
        raise ConfigError(f"--repeats {args.repeats} must be at least 1.")
    timings = measure(args.run, args.repeats)
    table = Table(title="one thread", caption="median (smallest to largest)")
    for heading in ("part", "time ms", "per"):
        table.add_column(heading, justify="right" if heading == "time ms" else "left")
    for timing in timings:
        table.add_row(timing.part, spread([value * 1e3 for value in timing.seconds], "{:.1f}"), timing.per)
    console = Console()
    console.print(table)
    if args.json is not None:
        args.json.write_bytes(bench_json("simulation", timing_figures(timings), machine_facts(), args.run))
        console.print(f"figures: {args.json}")
    return 0


@dataclass(frozen=True, kw_only=True)
class BenchArgs:
    """Compare and measure; every bench prints a table and writes JSON with --json."""

    which: Annotated[
        Annotated[ShapingArgs, tyro.conf.subcommand("shaping")]
        | Annotated[SimulationArgs, tyro.conf.subcommand("simulation")]
        | Annotated[ObserversArgs, tyro.conf.subcommand("observers")]
        | Annotated[FeasibilityArgs, tyro.conf.subcommand("feasibility")],
        tyro.conf.arg(name=""),
    ]
    """Which bench."""


def run(args: BenchArgs) -> int:
    """Run the bench that was named."""
    match args.which:
        case ShapingArgs() as shaping:
            return run_shaping(shaping)
        case SimulationArgs() as simulation:
            return run_simulation(simulation)
        case ObserversArgs() as observers:
            return run_observers(observers)
        case FeasibilityArgs() as feasibility:
            return run_feasibility(feasibility)
