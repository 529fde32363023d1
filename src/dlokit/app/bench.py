"""`dlokit bench`: comparisons, printed as a table and written as JSON."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.bench_bus import BusArgs, run_bus
from dlokit.app.bench_faults import FaultsArgs, run_faults_bench
from dlokit.app.bench_feasibility import FeasibilityArgs, run_feasibility
from dlokit.app.bench_fuzz import FuzzArgs, run_fuzz
from dlokit.app.bench_latency import LatencyArgs, run_latency
from dlokit.app.bench_observers import ObserversArgs, run_observers
from dlokit.app.bench_shaping import ShapingArgs, run_shaping
from dlokit.app.bench_stop import StopBenchArgs, run_stop_bench
from dlokit.app.machine import machine_facts
from dlokit.bench.report import bench_json, spread, timing_figures
from dlokit.bench.simulation import measure
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig


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
        | Annotated[FeasibilityArgs, tyro.conf.subcommand("feasibility")]
        | Annotated[StopBenchArgs, tyro.conf.subcommand("stop")]
        | Annotated[FaultsArgs, tyro.conf.subcommand("faults")]
        | Annotated[BusArgs, tyro.conf.subcommand("bus")]
        | Annotated[FuzzArgs, tyro.conf.subcommand("fuzz")]
        | Annotated[LatencyArgs, tyro.conf.subcommand("latency")],
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
        case StopBenchArgs() as stop:
            return run_stop_bench(stop)
        case FaultsArgs() as faults:
            return run_faults_bench(faults)
        case BusArgs() as bus:
            return run_bus(bus)
        case FuzzArgs() as fuzzing:
            return run_fuzz(fuzzing)
        case LatencyArgs() as latency:
            return run_latency(latency)
