"""`dlokit bench shaping`: compare planners and observers on the same starts and goals.

In a simulated cell the ground truth judges them. A real arm with a real camera has no ground truth: the system's own
estimate judges, and table and JSON file say so.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from itertools import chain
from pathlib import Path
from typing import Annotated, TypeVar

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, file_after, flag, value_of
from dlokit.app.console import prepare, progress_bar, say
from dlokit.app.shape.questions import TerminalOperator
from dlokit.errors import EXIT_FAULT, ConfigError
from dlokit.extras.bench.report import BenchFigure, bench_json, check_json
from dlokit.extras.bench.shaping.cases import (
    IDEAL,
    OWN_ESTIMATE,
    CaseResult,
    ShapingCase,
    ShapingMethod,
    cases,
    judged_by_truth,
    methods_of,
    with_method,
)
from dlokit.extras.bench.shaping.experiments import Experiment
from dlokit.extras.bench.shaping.figures import (
    COLUMNS,
    experiment_rows,
    figures,
    group_rows,
    outcomes,
    overview,
    verdict_lines,
    verdict_row,
)
from dlokit.extras.bench.shaping.metrics import falsely_converged, standing
from dlokit.extras.bench.shaping.pictures import draw
from dlokit.extras.bench.shaping.post_figures import fixture_lines
from dlokit.extras.bench.shaping.runner import runtime_of
from dlokit.extras.bench.shaping.suites import SEEDS_APART, SUITE_NAMES, VERSION, suite_of
from dlokit.extras.bench.shaping.sweep import Workers, check_address, claim_sweep_folder, describe, run_sweep
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.cell.config import EVERY_FACTOR
from dlokit.functional.robots.strategies import DRIVERS
from dlokit.system.config import RunConfig, one_of
from dlokit.system.configuration.preflight import check_before_start, require_one_world
from dlokit.system.operator_start import RealStart
from dlokit.system.request import NOTHING_OWN, Choices, OwnStrategies, RunRequest
from dlokit.system.results.run_folder import run_folder
from dlokit.system.results.run_result import machine_facts
from dlokit.system.shaping import Watcher
from dlokit.types.feasibility import Standing

TABLE_WIDTH = 190
MOST_EXPERIMENTS = 15
"""With more experiments than this, the table shows groups; the JSON file has all figures."""
_LEFT = 2

T = TypeVar("T")


def line_of(done: CaseResult) -> str:
    """One line about one case."""
    case, result = done.case, done.result
    rmse = "-" if result.rmse_m is None else f"{result.rmse_m * 1e3:.1f} mm"
    true = "-" if result.true_rmse_m is None else f"{result.true_rmse_m * 1e3:.1f} mm"
    judged, took = f"true {true:>8}", f"{result.sim_time_s:6.1f} s simulated in {result.wall_time_s:6.1f} s"
    if result.rmse_m is not None and result.true_rmse_m is None:
        judged, took = "by own estimate", f"{result.wall_time_s:6.1f} s"
    actions = "action" if result.actions == 1 else "actions"
    return (
        f"{case.experiment.name:12} seed {case.seed}  {case.method.name:14}  {result.outcome.value:10} "
        f"{result.actions:3d} {actions:7}  RMSE {rmse:>8}  {judged}  {took}"
        + ("  (FALSE)" if falsely_converged(result) else "")
        + (f"  ({result.reason})" if result.reason else "")
    )


def print_results(results: Sequence[CaseResult], console: Console) -> None:
    """Print the tables, the outcomes of the runs, and the goal verdicts compared with the outcomes."""
    # Wrapped figures are unreadable, so the width of a narrow or unknown terminal is ignored.
    wide = Console(file=console.file, width=max(console.width, TABLE_WIDTH), quiet=console.quiet)
    wide.print(_table(results))
    for heading, lines in (
        ("how runs ended", outcomes(results)),
        ("verdicts", verdict_lines(results)),
        ("fixtures", fixture_lines(results)),
    ):
        lines = list(lines)
        if not lines:
            continue
        console.print(f"[bold]{heading}[/]", highlight=False)
        for line in lines:
            say(console, f"  {line}")
    for done in results:
        if done.fault:
            where = f"{done.case.experiment.name}, seed {done.case.seed}, {done.case.method.name}"
            say(console, f"failed, repeat it with the same command: {where}: {done.fault}")


def _table(results: Sequence[CaseResult]) -> Table:
    truth = judged_by_truth(results)
    false = "false: only the estimate is below the threshold" if truth else f"judged by {OWN_ESTIMATE}"
    table = Table(caption=f"median (largest) over runs; by kind: all runs; {false}")
    for at, heading in enumerate(COLUMNS):
        table.add_column(heading, justify="left" if at < _LEFT else "right", no_wrap=True)
    few = len({done.case.experiment.name for done in results}) <= MOST_EXPERIMENTS
    rows = chain(experiment_rows(results), group_rows(results)) if few else group_rows(results)
    # When all goals have the same verdict, the row equals the last one and is omitted.
    repeated = {verdict_row(said) for said in Standing if all(standing(done.result) is said for done in results)}
    for row in overview((row for row in rows if row.name not in repeated), truth=truth):
        table.add_row(*row)
    return table


_OF_RUNS = RunConfig()
FULL_SEEDS = 5
QUICK_SEEDS = {"paper": 3, "goals": 1, "stiffness": 2, "wires": 1, "posts": 1, "pegs": 3}
QUICK_JOBS = 2


def shaping_defaults(request: RunRequest) -> RunConfig:
    """The default settings of every run that is requested. Raises `ConfigError`."""
    # The bench compares the verdict with the outcome, so it also tries goals judged infeasible.
    shipped = {"record": False, "task.infeasible": "try"}
    return replace(request, settings={**shipped, **request.settings}).configured()


@dataclass(frozen=True, kw_only=True)
class ShapingArgs:
    """Compare planners and observers on the same starts and goals; in the simulated cell the ground truth judges.

    Try
      dlokit bench shaping --quick --planner farthest,rollout
      dlokit bench shaping --suite goals goals.npy --randomised --seeds 2 --jobs 2 --out runs/goals
      dlokit bench shaping --suite stiffness --oracle
      dlokit bench shaping --suite wires --randomised --config examples/configurations/wire.toml
      dlokit bench shaping --installation lab.toml --driver my-arm --out runs/lab      your own arm and camera

    Without a cell the runs are live and judged by the system's own estimate. Before each case the arm brings the DLO
    to the case's start; it leaves a DLO that lies there already, from the previous case or laid by hand.
    Prints tables with 95 % intervals, draws start, goal and end of every case, and stores the files of each run in its
    own folder. Ctrl-C keeps the finished runs; the same command with the same --out continues the sweep.
    """

    suite: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME [FILE]")] = ("paper",)
    """paper: the five experiments of the paper. goals FILE: curves of a .npy file (G, K, 3). stiffness: an S for rods
    of increasing stiffness. wires: the paper's experiments with published wires, which deform plastically. posts: goals
    among posts. pegs: a rope around two pegs of a public board."""
    seeds: Annotated[int | None, flag("INT", "5; 1 to 3 with --quick")] = None
    """Use seeds 0 to K-1 for each experiment."""
    first_seed: int = 0
    """Use seeds F to F+K-1 instead of 0 to K-1, to report on other seeds than those used for tuning (1000 and more)."""
    planner: Annotated[str, flag("NAMES", f"{_OF_RUNS.planning.strategy.name}, or the configuration's")] = ""
    """Planners to compare on the same starts, e.g. farthest,rollout."""
    camera: Annotated[str | None, one_of(CAMERAS, "the configuration's")] = None
    """Camera, as in `dlokit shape`: simulated (the paper's stereo camera) and simulated-d435 (depth) see the cell."""
    driver: Annotated[str | None, one_of(DRIVERS, "the configuration's")] = None
    """Driver of the arm: simulated (the cell), or the driver of an installed package, with a real camera."""
    observer: Annotated[str, flag("NAMES", f"{_OF_RUNS.observer.strategy.name}, or the configuration's")] = ""
    """Observers to compare, each combined with every planner, e.g. map,cpd."""
    operator_confirms: bool = False
    """Start a real arm without questions, as in `dlokit shape`; otherwise they are asked once, before the first run."""
    randomised: bool = False
    """Draw friction, stiffness, weight, curl, hand-eye error, table tilt, light and colour from each seed."""
    oracle: bool = False
    """Use the ground truth of the cell as the state instead of the camera, to evaluate planning without perception."""
    blind: bool = False
    """Run every planner also without knowledge of the fixtures; suite posts and pegs."""
    quick: bool = False
    """Fewer seeds, in goals, stiffness and wires also fewer experiments, and two runs in parallel; at most 15 minutes
    on two cores."""
    jobs: Annotated[int | None, flag("INT", "1; 2 with --quick")] = None
    """Number of runs in parallel, each in its own process."""
    cluster: str = ""
    """Address of a cluster whose workers run the cases: tcp://HOST:PORT (Dask) or ray://HOST:PORT."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write all figures to this JSON file."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-bench-shaping/")] = None
    """Folder for the runs; the folder of an interrupted sweep is continued."""
    config: Annotated[Path | None, flag("FILE")] = None
    """Configuration file; flags of this command line override its settings."""
    installation: Annotated[Path | None, flag("FILE", "the configuration's")] = None
    """Installation file with the places of table, arms and camera, as in `dlokit shape --installation`."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=lambda: shaping_defaults(RunRequest()))
    """Settings of every run; the bench sets start, goal, seed, runtime and headless. The bench also tries goals judged
    infeasible, and records runs only with `--record`."""


def run_shaping(args: ShapingArgs) -> int:
    """Run the suite; exit code 0 when every run ended, converged or not, 1 when at least one failed with an error."""
    return EXIT_FAULT if any(done.fault for done in compare(args, Console()).results) else 0


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapingComparison:
    """The result of `dlokit.bench.shaping`; `print` shows the tables."""

    results: tuple[CaseResult, ...]
    """Every run: its case (experiment, seed, method) and its `result`, as in result.json."""
    folder: Path
    """The runs' folders."""
    pictures: tuple[Path, ...]
    """Start, goal and end of every run, drawn on pages."""

    @property
    def figures(self) -> tuple[BenchFigure, ...]:
        """Every figure with its 95 % interval: case, method, metric, value, low, high, unit, n."""
        return tuple(figures(self.results))

    def __str__(self) -> str:
        text = StringIO()
        print_results(self.results, Console(file=text))
        return text.getvalue().rstrip()

    def __repr__(self) -> str:
        return f"<ShapingComparison: {len(self.results)} runs, {self.folder}>"


def compare(
    args: ShapingArgs, console: Console, own: OwnStrategies = NOTHING_OWN, interrupted: Callable[[], bool] | None = None
) -> ShapingComparison:
    """Run the suite and print its figures; `own` are strategies of this program, installed for its duration.

    If `interrupted` returns True, it ends after the current run as with Ctrl-C. Raises `InputError` before the first
    run.
    """
    suite, experiments = _suite(args)
    config, methods, todo, workers = _plan(args, suite, experiments)
    if not config.has_cell:
        _check_without_cell(args, config, experiments, workers, own)
    check_json(args.json)
    folder = args.out or run_folder(None, "bench-shaping")
    claim_sweep_folder(folder, config, suite, experiments, oracle=args.oracle)
    say(console, _headline(args, suite, config, todo))
    expected = expected_duration(suite, len(todo), workers.jobs)
    if expected and config.has_cell and not args.oracle and not args.cluster:
        say(console, expected)
    workers = replace(workers, watch=_SweepWatcher(args, config, console))
    if not args.cluster:
        for method in methods:
            prepare(console, with_method(config, method))
    sweep = run_sweep(todo, config, folder, workers, own)
    results = followed(
        sweep if interrupted is None else _until(interrupted, sweep),
        len(todo),
        folder,
        console,
        line_of=line_of,
        print_all=lambda done: print_results(sorted(done, key=_order(todo)), console),
    )
    results.sort(key=_order(todo))
    if args.json is not None:
        described = describe(config, suite, experiments, oracle=args.oracle)
        judge = "ground truth of the simulated cell (true_rmse_m)" if judged_by_truth(results) else OWN_ESTIMATE
        seeds = sorted({case.seed for case in todo})
        facts = {**described, "seeds": seeds, "jobs": workers.jobs, "judged_by": judge}
        args.json.write_bytes(bench_json("shaping", figures(results), machine_facts(), facts))
        say(console, f"figures: {args.json}")
    pictures = draw(results, folder, lambda case: case.experiment.configured(config).installation.fixtures)
    for path in pictures:
        say(console, f"pictures: {path}")
    say(console, f"runs: {folder}")
    return ShapingComparison(results=tuple(results), folder=folder, pictures=tuple(pictures))


def followed(
    runs: Iterable[T],
    total: int,
    folder: Path,
    console: Console,
    *,
    line_of: Callable[[T], str],
    print_all: Callable[[list[T]], None],
) -> list[T]:
    """Collect all `runs`; print a line as each ends, a progress bar on a terminal, and a table of all at the end.

    On Ctrl-C it prints the table of the finished runs and how to continue, and raises the interrupt again.
    """
    done: list[T] = []
    with progress_bar(console) as progress:
        bar = progress.add_task("shaping", total=total)
        try:
            for run in runs:
                done.append(run)
                progress.advance(bar)
                say(console, f"{len(done)}/{total} {line_of(run)}")
        except KeyboardInterrupt:
            if done:
                print_all(done)
            say(console, f"{len(done)} of {total} runs are finished; the same command with --out {folder} continues.")
            raise
    print_all(done)
    return done


def _until(interrupted: Callable[[], bool], sweep: Iterator[CaseResult]) -> Iterator[CaseResult]:
    for done in sweep:
        yield done
        if interrupted():
            raise KeyboardInterrupt


def _suite(args: ShapingArgs) -> tuple[str, tuple[Experiment, ...]]:
    name, *files = args.suite or ("",)
    if len(files) > 1:
        raise ConfigError(f"--suite {' '.join(args.suite)}: a suite takes at most one file ({', '.join(SUITE_NAMES)}).")
    return name, suite_of(name, Path(files[0]) if files else None, quick=args.quick)


def _plan(
    args: ShapingArgs, suite: str, experiments: Sequence[Experiment]
) -> tuple[RunConfig, tuple[ShapingMethod, ...], list[ShapingCase], Workers]:
    """Determine the runs; raise an error for invalid arguments before any run starts."""
    seeds = args.seeds if args.seeds is not None else (QUICK_SEEDS[suite] if args.quick else FULL_SEEDS)
    config = _randomised(_seen(args))
    jobs = args.jobs if args.jobs is not None else (QUICK_JOBS if args.quick and config.has_cell else 1)
    if seeds < 1 or jobs < 1 or args.first_seed < 0 or args.first_seed + seeds > SEEDS_APART:
        raise ConfigError(
            f"--seeds {seeds}, --jobs {jobs}, --first-seed {args.first_seed}: they must be at least 1, 1 and 0, and "
            f"seeds must be below {SEEDS_APART}."
        )
    if args.oracle and args.observer:
        raise ConfigError(f"--oracle replaces the observer: omit --observer {args.observer}.")
    observers = (IDEAL,) if args.oracle else _names(args.observer)
    methods = methods_of(config, observers, _names(args.planner), blind=args.blind)
    for method in methods:
        with_method(config, method)
    check_address(args.cluster)
    todo = list(cases(experiments, seeds, methods, first_seed=args.first_seed))
    return config, methods, todo, Workers(jobs=jobs, cluster=args.cluster)


def _seen(args: ShapingArgs) -> ShapingArgs:
    """The arguments with the camera chosen by name. Raises `ConfigError` if it does not see the cell."""
    run = RunRequest(choices=Choices(camera=args.camera, driver=args.driver), prefix="--").on(args.run)
    planned = replace(run, runtime=runtime_of(run), headless=True, goal="S")
    if planned.has_cell:  # not all of `check_before_start`: an oracle needs no OpenGL
        require_one_world(planned)
        from dlokit.system.configuration.installation_checks import check_installation  # loads the kinematics

        check_installation(planned)
    else:
        check_before_start(planned, operator_confirms=args.operator_confirms)
    return replace(args, run=run)


def _check_without_cell(
    args: ShapingArgs, config: RunConfig, experiments: Sequence[Experiment], workers: Workers, own: OwnStrategies
) -> None:
    """Raise `ConfigError` for options that need a simulated cell."""
    where = f"--camera {config.camera.name} and --driver {config.driver.name} are no simulated cell"
    if args.oracle:
        raise ConfigError(f"{where}, and --oracle needs its ground truth: omit --oracle.")
    if config.cell.randomised:
        raise ConfigError(f"{where}, and --randomised draws one from each seed: omit --randomised.")
    if workers.jobs > 1 or workers.cluster:
        raise ConfigError(f"{where}: with one arm runs cannot be parallel: use --jobs 1 and no --cluster.")
    if changed := next((one for one in experiments if one.dlo is not None), None):
        raise ConfigError(
            f"{where}, in which suite {args.suite[0]} changes the DLO ({changed.name}): choose --suite paper or goals, "
            "once for each DLO that you lay on the table."
        )
    if own.planners or own.observers:
        raise ConfigError(
            f"{where}: its processes do not know objects of this program; install the strategies as a package "
            "(docs/how-to/add-a-planner.md)."
        )


class _SweepWatcher(Watcher):
    """Asks the operator of a real arm once for all runs of a sweep, which may take hours; acknowledges Ctrl-C."""

    def __init__(self, args: ShapingArgs, config: RunConfig, console: Console) -> None:
        self._operator = TerminalOperator(confirms=args.operator_confirms, console=console)
        self._driver = config.driver.name
        self._console = console
        self._asked = False

    def stopping(self, by: str) -> None:
        """Say what happens, because a run with processes takes some seconds to end."""
        say(self._console, f"{by}: the arms brake, the running case is dropped, and the sweep ends; some seconds")

    async def confirm(self, start: RealStart) -> None:
        """Announce the motions and ask once; before later runs only check that the camera sees the DLO."""
        if not self._asked:
            say(
                self._console,
                f"--driver {self._driver} moves a real arm in every run, and before it to lay the start. Your answers "
                "are for all of them: stay with the arm; `dlokit stop` brakes it, Ctrl-C ends the sweep.",
            )
        await self._operator.confirm(start)
        if not self._asked:
            self._asked = True
            self._operator = TerminalOperator(confirms=True, console=Console(quiet=True))


def _randomised(args: ShapingArgs) -> RunConfig:
    cell = args.run.cell
    if not args.randomised:
        return args.run
    if cell.randomised:
        raise ConfigError("--randomised draws all parameters: omit it to choose them with --cell.randomised.")
    return replace(args.run, cell=replace(cell, randomised=EVERY_FACTOR))


def _names(listed: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name.strip() for name in listed.split(",") if name.strip()))


def _headline(args: ShapingArgs, suite: str, config: RunConfig, todo: Sequence[ShapingCase]) -> str:
    if config.has_cell:
        where = "a randomised cell for each seed" if config.cell.randomised else "one cell for all"
    else:
        where = "no arm moves (dry run)" if config.dry_run else f"moved by driver {config.driver.name}"
    seen = "state from the ground truth (oracle)" if args.oracle else f"seen by camera {config.camera.name}"
    threshold = f"threshold {config.task.threshold_m * 1e3:g} mm"
    judged = "" if config.has_cell else f", judged by {OWN_ESTIMATE}"
    return f"suite {suite}, version {VERSION}: {len(todo)} runs, {where}, {seen}, {threshold}{judged}"


_RUN_S = {"paper": 14.0, "goals": 14.0, "wires": 28.0}
"""Time of a run on an idle core [s] by suite, where it was measured (docs/reference/bench-shaping.md)."""


def expected_duration(suite: str, runs: int, jobs: int) -> str:
    """About how long the runs of a suite in the simulated cell take, as text; empty where no run was measured."""
    if suite not in _RUN_S:
        return ""
    minutes = _RUN_S[suite] * math.ceil(runs / jobs) / 60.0
    took = f"{minutes / 60.0:.1f} h" if minutes >= 90.0 else f"{max(1, round(minutes))} min"
    return f"about {took} on {'an idle core' if jobs == 1 else f'{jobs} idle cores'}, and more on a busy machine"


def _order(todo: Sequence[ShapingCase]) -> Callable[[CaseResult], int]:
    rank = {case.folder_name: at for at, case in enumerate(todo)}
    return lambda done: rank[done.case.folder_name]


_SET_BY_BENCH = {
    "--start": "--suite chooses starts and goals",
    "--goal": "--suite chooses starts and goals, `--suite goals FILE` your own",
    "--seed": "--seeds and --first-seed choose the seeds",
    "--runtime": "runs in the simulated cell are in lockstep, others live",
    "--headless": "no run has a viewer",
    "--no-headless": "no run has a viewer",
    "--port": "no run has a viewer",
}
"""Options of a run that the bench sets, with what determines them."""


def _defaults(arguments: Sequence[str]) -> ShapingArgs:
    for name in (argument.partition("=")[0] for argument in arguments):
        if (why := _SET_BY_BENCH.get(name)) is not None:
            raise ConfigError(f"{name} has no effect in `dlokit bench shaping`: {why}; leave it out.")
    config, installation = (file_after(flag, arguments) for flag in ("--config", "--installation"))
    choices = Choices(
        installation=installation, camera=value_of(arguments, "--camera"), driver=value_of(arguments, "--driver")
    )
    run = shaping_defaults(RunRequest(config=config, choices=choices, prefix="--"))
    return ShapingArgs(config=config, installation=installation, run=run)


_OF_ONE_RUN = {"--dry-run", "--twin"}
"""Options of a run that are for a person who rehearses it."""

COMMAND = CliCommand(ShapingArgs, run_shaping, _defaults, unused=frozenset({*_SET_BY_BENCH, *_OF_ONE_RUN}))
