"""`dlokit bench simulation`: where the time of a lockstep run goes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.commands import CliCommand, flag
from dlokit.bench.report import bench_json, spread, timing_figures
from dlokit.bench.simulation import measure
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.results.run_record import machine_facts


@dataclass(frozen=True, kw_only=True)
class SimulationArgs:
    """Measure where the time of a lockstep run goes: physics, rendering, perception, observer, model."""

    repeats: int = 20
    """Repetitions of each part."""
    json: Annotated[Path | None, flag("FILE")] = None
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


COMMAND = CliCommand(SimulationArgs, run_simulation)
