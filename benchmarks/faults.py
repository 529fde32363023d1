"""Whether live runs end as they should when a fault is injected into them at a random time, with the arm stopped.

    python benchmarks/faults.py --faults kill-decision,freeze-camera --runs 3
    python benchmarks/faults.py --out runs/faults --json faults.json

Each run is a `dlokit shape` of one or two actions in its own processes. docs/reference/bench-faults.md lists the
faults; the seed determines when a fault is injected. Each run is judged from outside: by its result and exit code, the
sensors of the arm, the ground truth, the recording, and the process table of the machine. Ctrl-C keeps the finished
runs; the same command with the same --out continues the sweep.

Exit code 0: every run ended as required; 3: at least one did not.
"""

import asyncio
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from dlokit import __version__
from dlokit.errors import EXIT_OTHERWISE, ConfigError, InputError
from dlokit.system.results.run_folder import claim_run_folder, run_folder
from parts.command import check_json, count_in, figures_table, run_study, value_in, write_figures
from parts.faults.judging import BRAKES_WITHIN_S, VALUES, RunFinding, all_right, faults_of, figures
from parts.faults.table import BY_NAME, FAULTS, Fault
from parts.faults.trial import FaultCase, cases, finished, try_case

SWEEP_FILE = "faults.json"
COLUMNS = {
    "runs": count_in("ended as it should"),
    "not\nstruck": value_in("runs not struck"),
    "right %\n(≥)": value_in("ended as it should", 100.0),
    "con-\nverged %": value_in("converged", 100.0),
    "recovers\ns, max": value_in("max time to recover", digits=1),
    "brakes\nms": value_in("median braking begins after", 1e3),
    "max": value_in("max braking begins after", 1e3),
    "lost\ns, max": value_in("max recording lacks", digits=2),
    "left": value_in("processes left behind"),
}


@dataclass(frozen=True, kw_only=True)
class Args:
    """Inject faults into live runs at random times, and check that the runs end correctly with the arm stopped."""

    faults: str = ""
    """Only these faults, e.g. kill-decision,drop-camera; otherwise all."""
    runs: int = 8
    """Runs of each fault; eight of all are almost 300 runs."""
    seed: int = 0
    """Of the first run of a fault."""
    out: Path | None = None
    """Folder for the runs, otherwise runs/<time>-faults/; the folder of an interrupted sweep is continued."""
    json: Path | None = None
    """Also write all figures to this file."""


def run(args: Args) -> int:
    """Execute the runs that are not finished yet, and print the results; exit code 3 where one was wrong."""
    chosen = faults_named(args.faults)
    if args.runs < 1:
        raise ConfigError(f"--runs is {args.runs}; it must be 1 or more.")
    check_json(args.json)
    folder, console = args.out or run_folder(None, "faults"), Console()
    claim_faults_folder(folder, args.seed)
    console.print(f"runs: {folder}", markup=False, soft_wrap=True)
    todo, results = list(cases(chosen, args.runs, args.seed)), list[tuple[Fault, RunFinding]]()
    try:
        for case in todo:
            finding = found(case, folder / case.folder_name)
            results.append((case.fault, finding))
            line = f"{len(results)}/{len(todo)} {line_of(case, finding)}"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    finally:  # after Ctrl-C too
        rows = figures(results)
        if results:
            caption = f"braking must begin within {BRAKES_WITHIN_S * 1e3:.0f} ms"
            console.print(figures_table("faults", caption, rows, COLUMNS))
    settings = {"seed": args.seed, "faults": [fault.name for fault in chosen], "runs": args.runs}
    write_figures(args.json, "faults", rows, settings, console)
    return 0 if all_right(results) else EXIT_OTHERWISE


def faults_named(names: str) -> tuple[Fault, ...]:
    """The faults of a list of names, all without one. Raises `ConfigError` for a name without a fault."""
    wanted = [name.strip() for name in names.split(",") if name.strip()]
    if unknown := [name for name in wanted if name not in BY_NAME]:
        raise ConfigError(f"--faults {unknown[0]!r} is unknown; choose from {', '.join(BY_NAME)}.")
    return tuple(fault for fault in FAULTS if not wanted or fault.name in wanted)


def claim_faults_folder(folder: Path, seed: int) -> None:
    """Claim a folder for a new or an interrupted sweep.

    Raises `InputError` when it contains other files, or runs of another seed or version.
    """
    about, path = msgspec.json.encode({"version": __version__, "seed": seed}), folder / SWEEP_FILE
    if not path.is_file():
        claim_run_folder(folder)
        path.write_bytes(about)
    elif path.read_bytes() != about:
        raise InputError(f"--out {folder} has runs of another seed or version ({path}): name another folder.")


def found(case: FaultCase, folder: Path) -> RunFinding:
    """The finding of an earlier sweep, or of a new run."""
    return finished(folder) or asyncio.run(try_case(case, folder))


def line_of(case: FaultCase, finding: RunFinding) -> str:
    """One line about one run."""
    head = f"{case.folder_name}: "
    if finding.skipped:
        return f"{head}skipped: {finding.skipped}"
    if finding.broken:
        return f"{head}BROKEN: {finding.broken.splitlines()[0]}"
    if not finding.struck:
        return f"{head}the task ended before the fault was injected, each time"
    said = [f"in {finding.step}", "no result" if finding.outcome is None else finding.outcome.value]
    said += [line[:80] for line in finding.reason.splitlines()[:1]]
    values = ((what, value(finding), unit) for what, value, unit in VALUES)
    said += [f"{what} {value:.3f} {unit}" for what, value, unit in values if value is not None]
    wrong = faults_of(finding, case.fault)
    verdict = "as required" if not wrong else f"WRONG: {'; '.join(wrong)}"
    return f"{head}{', '.join(said)} ({finding.wall_s:.0f} s) {verdict}"


if __name__ == "__main__":
    run_study(Args, run, __doc__)
