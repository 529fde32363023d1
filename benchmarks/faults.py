"""`python benchmarks/faults.py`: inject faults into live runs and judge how the runs end."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

from dlokit.app.bench.progress import followed
from dlokit.app.commands import flag
from dlokit.app.console import say
from dlokit.app.shape.preflight import check_before_start, prepare
from dlokit.benches.report import bench_json, check_json_path
from dlokit.errors import EXIT_OTHERWISE, ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import run_folder
from dlokit.system.results.run_record import machine_facts
from dlokit.types.flow import RunOutcome
from parts.command import run_study
from parts.faults.judging import (
    BRAKES_WITHIN_S,
    FaultRow,
    RunFinding,
    all_right,
    fault_rows,
    faults_of,
    figures,
    recovered_s,
)
from parts.faults.sweep import claim_faults_folder, describe, run_faults
from parts.faults.table import BY_NAME, FAULTS, Fault
from parts.faults.trial import FaultCase, cases


def line_of(case: FaultCase, finding: RunFinding) -> str:
    """One line about one run."""
    head = f"{case.folder_name}: "
    if finding.skipped:
        return f"{head}skipped: {finding.skipped}"
    if finding.broken:
        return f"{head}BROKEN: {finding.broken.splitlines()[0]}"
    if not finding.struck:
        return f"{head}the task ended before the fault was injected, each time"
    wrong = faults_of(finding, case.fault)
    ended = "no result" if finding.outcome is None else finding.outcome.value
    said = [f"in {finding.step}", ended]
    if finding.reason:
        said.append(finding.reason.splitlines()[0][:80])
    if finding.true_rmse_m is not None:
        said.append(f"true {finding.true_rmse_m * 1e3:.1f} mm")
    if finding.braked_s is not None:
        said.append(f"braked after {finding.braked_s * 1e3:.0f} ms")
    if finding.named_s is not None:
        said.append(f"named after {finding.named_s:.2f} s")
    if finding.recovered_after_s and recovered_s(finding) is not None:
        said.append(f"recovered after {finding.recovered_after_s:.0f} s")
    if finding.lost_s is not None:
        said.append(f"recording lacks {finding.lost_s:.2f} s")
    verdict = "as required" if not wrong else f"WRONG: {'; '.join(wrong)}"
    return f"{head}{', '.join(said)} ({finding.wall_s:.0f} s) {verdict}"


def faults_table(rows: Sequence[FaultRow]) -> Table:
    """The table of results, one row for each fault."""
    caption = f"braking must begin within {BRAKES_WITHIN_S * 1e3:.0f} ms; times: median, max"
    # Without lines between the columns the table fits into a terminal of 80 columns.
    table = Table(title="faults", caption=caption, box=None, padding=(0, 1, 0, 0))
    headings = ("fault", "runs", "right", "at\nleast", "con-\nverged", "recovers\ns", "brakes\nms", "lost\ns", "left")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "fault" else "right", no_wrap=True)
    for row in rows:
        table.add_row(row.name, *_cells(row))
    return table


def _cells(row: FaultRow) -> tuple[str, ...]:
    skipped = f" ({len(row.others)} not struck)" if row.others else ""
    rate = row.rate
    if rate is None or rate.low is None:
        return (f"0{skipped}", *[""] * 7)
    return (
        f"{len(row.judged)}{skipped}",
        str(row.right),
        f"{rate.low:.0%}",
        str(sum(finding.outcome is RunOutcome.CONVERGED for finding in row.findings)),
        _spread(row.values(recovered_s), 1.0, 1),
        _spread(row.values(lambda finding: finding.braked_s), 1e3, 0),
        _spread(row.values(lambda finding: finding.lost_s), 1.0, 2),
        str(sum(len(finding.remaining_processes) for finding in row.findings)),
    )


def _spread(values: Sequence[float], factor: float, digits: int) -> str:
    if not values:
        return ""
    return f"{np.median(values) * factor:.{digits}f}, {max(values) * factor:.{digits}f}"


FULL_RUNS = 8
QUICK = ("kill-decision", "freeze-camera", "kill-simulation", "slip-grasp", "fill-disk")
"""One fault of each family."""


def _headless() -> RunConfig:
    return RunConfig(runtime="live", headless=True)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Inject faults into live runs at random times, and check that the runs end correctly with the arm stopped.

    Try
      python benchmarks/faults.py --quick
      python benchmarks/faults.py --faults kill-decision,freeze-camera --runs 3
      python benchmarks/faults.py --out runs/faults --json faults.json

    Each run is a `dlokit shape` of one or two actions in its own processes. The faults are listed in
    docs/reference/bench-faults.md; the seed determines when a fault is injected. Each run is judged from outside: by
    its result and exit code, the sensors of the arm, the ground truth, the recording, and the process table of the
    machine. Ctrl-C keeps the finished runs; the same command with the same --out continues the sweep.

    Exit code 0: every run ended as required; 3: at least one did not.
    """

    faults: Annotated[str, flag("NAMES", "all")] = ""
    """Only these faults, e.g. kill-decision,drop-camera."""
    runs: Annotated[
        int | None,
        flag("INT", "8, more than 150 runs in all; 1 with --quick"),
    ] = None
    """Runs of each fault."""
    quick: bool = False
    """One run of each of five faults; takes about five minutes."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write all figures to this JSON file."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-bench-faults/")] = None
    """Folder for the runs; the folder of an interrupted sweep is continued."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=_headless)
    """Settings of every run. The bench sets start, goal and runtime; --seed is the seed of the first run of a fault."""


def run(args: Args) -> int:
    """Execute the runs that are not finished yet, and print the results."""
    chosen = _chosen(args)
    runs = args.runs if args.runs is not None else (1 if args.quick else FULL_RUNS)
    if runs < 1:
        raise ConfigError(f"--runs is {runs}; it must be 1 or more.")
    check_json_path(args.json)
    if args.run.moves_real_arm:
        raise ConfigError(f"--driver {args.run.driver.name} moves a real arm; faults are injected in the cell alone.")
    check_before_start(args.run)
    folder = args.out or run_folder(None, "bench-faults")
    claim_faults_folder(folder, args.run)
    console = Console()
    prepare(console, args.run)
    todo = list(cases(chosen, runs))
    done = followed(
        run_faults(todo, args.run, folder),
        len(todo),
        folder,
        console,
        what="faults",
        line_of=lambda run: line_of(*run),
        print_all=lambda runs: console.print(faults_table(fault_rows(_faults_of(runs)))),
    )
    results = _faults_of(done)
    if args.json is not None:
        facts = {**describe(args.run), "faults": [fault.name for fault in chosen], "runs": runs}
        args.json.write_bytes(bench_json("faults", figures(results), machine_facts(), facts))
        say(console, f"figures: {args.json}")
    say(console, f"runs: {folder}")
    return 0 if all_right(results) else EXIT_OTHERWISE


def _faults_of(runs: list[tuple[FaultCase, RunFinding]]) -> list[tuple[Fault, RunFinding]]:
    return [(case.fault, finding) for case, finding in runs]


def _chosen(args: Args) -> tuple[Fault, ...]:
    names = tuple(dict.fromkeys(name.strip() for name in args.faults.split(",") if name.strip()))
    if unknown := [name for name in names if name not in BY_NAME]:
        raise ConfigError(f"--faults {unknown[0]!r} is unknown; choose from {', '.join(BY_NAME)}.")
    if not names and args.quick:
        names = QUICK
    return tuple(fault for fault in FAULTS if not names or fault.name in names)


if __name__ == "__main__":
    run_study(Args, run, None)
