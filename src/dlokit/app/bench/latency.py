"""`dlokit bench latency`: exposure → cloud → targets → state → decision, in a live run."""

import asyncio
import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.bench.latency.hops import Hops, hops, named
from dlokit.bench.latency.listening import listen
from dlokit.bench.report import BenchFigure, bench_json, figure
from dlokit.errors import InputError, MachineError
from dlokit.evaluation.statistics import median
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.results.run_record import machine_facts

LOOK_EVERY_S = 0.2
MAIN = ("-c", "from dlokit.app.main import main; main()")
STARTED_WITHIN_S = 300.0
"""Eight processes that import their libraries, on a machine that does other things."""
ENDED_WITHIN_S = 30.0


@dataclass(frozen=True, kw_only=True)
class LatencyArgs:
    """Time a live run from the exposure of each pair of pictures to the decision, hop by hop."""

    start: str = "I"
    """Where the DLO lies, as `dlokit shape` takes it."""
    goal: str = "S"
    """Where it shall lie."""
    seed: int = 0
    """Of the run."""
    limit_s: float = 600.0
    """The run is ended so long after its start, and what was heard by then is counted."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write every figure to this file."""


def run_latency(args: LatencyArgs) -> int:
    """Run, listen and print; exit code 0."""
    console = Console()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        with _live_run(args, out, Path(folder) / "log.txt") as process:
            system = _found(process, out, Path(folder) / "log.txt")
            sent = asyncio.run(listen(system.bus, lambda: _wait(process, args.limit_s)))
    found = hops(sent)
    console.print(_table(found))
    if args.json is not None:
        config = {"start": args.start, "goal": args.goal, "seed": args.seed}
        args.json.write_bytes(bench_json("latency", _figures(found), machine_facts(), config))
        console.print(f"figures: {args.json}")
    return 0


@contextmanager
def _live_run(args: LatencyArgs, out: Path, log_file: Path) -> "Generator[subprocess.Popen[bytes]]":
    command = (sys.executable, *MAIN, "shape", "--runtime", "live", "--headless", "--out", str(out))
    choices = ("--start", args.start, "--goal", args.goal, "--seed", str(args.seed))
    with log_file.open("wb") as log, subprocess.Popen((*command, *choices), stdout=log, stderr=log) as process:
        try:
            yield process
        finally:
            process.terminate()
            _wait(process, ENDED_WITHIN_S)
            process.kill()


def _wait(process: "subprocess.Popen[bytes]", limit_s: float) -> None:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(limit_s)


def _found(process: "subprocess.Popen[bytes]", out: Path, log_file: Path) -> RunningSystem:
    """The run's system, once it is there."""
    until_s = time.monotonic() + STARTED_WITHIN_S
    while process.poll() is None and time.monotonic() < until_s:
        try:
            return the_running_system(out)
        except InputError:
            time.sleep(LOOK_EVERY_S)
    raise MachineError(f"the live run did not start: {log_file.read_text(encoding='utf-8')[-500:]}")


def _table(found: Hops) -> Table:
    table = Table(title="a live run", caption="machine's time ms; one row a hop, and the whole way")
    for heading in ("hop", "median", "95 %", "largest", "looks"):
        table.add_column(heading, justify="left" if heading == "hop" else "right")
    for pair, seconds in found.items():
        if seconds:
            middle, high, largest = np.quantile(seconds, (0.5, 0.95, 1.0)) * 1e3
            table.add_row(named(pair), f"{middle:.1f}", f"{high:.1f}", f"{largest:.1f}", str(len(seconds)))
        else:
            table.add_row(named(pair), "-", "-", "-", "0")
    return table


def _figures(found: Hops) -> Sequence[BenchFigure]:
    return [
        figure(named(pair), "dlokit", "median time", median(seconds), "s") for pair, seconds in found.items() if seconds
    ]


COMMAND = CliCommand(LatencyArgs, run_latency)
