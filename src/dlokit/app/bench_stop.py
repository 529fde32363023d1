"""`dlokit bench stop`: how soon the arm brakes when its commander is lost, and how often for nothing."""

import asyncio
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.command import Command, flag
from dlokit.app.machine import machine_facts
from dlokit.bench.faults.figures import percentile_s, stop_figures
from dlokit.bench.faults.stopping import StopFigures, StopPlan, measure_stops
from dlokit.bench.report import bench_json
from dlokit.errors import ConfigError, InputError
from dlokit.system.config import RunConfig

BAR_S = 0.25
"""Braking begins within this, for 99 of 100 faults."""
EXIT_BELOW_BAR = 3


@dataclass(frozen=True, kw_only=True)
class StopBenchArgs:
    """Kill and freeze the commander of a moving arm at random times on a busy machine: when does braking begin?

    Cell, robot and commander are processes of this machine. Times are by its monotonic clock, from the signal until the
    arm is heard to brake; it tells 50 times a second. Then how often the arm brakes though nothing is done to anybody.
    Exit code 0: all begin within 0.25 s (p99) and none for nothing; 3: not so.
    """

    kills: int = 100
    """Commanders killed (SIGKILL)."""
    freezes: int = 100
    """Commanders frozen (SIGSTOP), and thawed afterwards."""
    quiet_s: float = 600.0
    """Time in which nothing is done to the commander in motion [s]."""
    busy: int = 4
    """Processes that keep the machine busy meanwhile."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write every figure to this file."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """Settings of the system, e.g. --robot.commander-lease-s; --seed gives the times at which faults come."""


def run_stop_bench(args: StopBenchArgs) -> int:
    """Measure and print."""
    if min(args.kills, args.freezes, args.busy) < 0 or not 0.0 <= args.quiet_s < float("inf"):
        raise ConfigError("--kills, --freezes, --busy and --quiet-s must be 0 or more.")
    if args.json is not None and not args.json.resolve().parent.is_dir():
        raise InputError(f"--json {args.json}: there is no folder {args.json.resolve().parent}; create it first.")
    console = Console()
    plan = StopPlan(
        run=replace(args.run, runtime="live", headless=True),
        kills=args.kills,
        freezes=args.freezes,
        quiet_s=args.quiet_s,
        busy_processes=args.busy,
        seed=args.run.seed,
    )
    with console.status("starting") as status:
        said = status.update if console.is_terminal else console.print
        figures = asyncio.run(measure_stops(plan, said))
    console.print(stops_table(figures, args.busy))
    if args.json is not None:
        settings = {"seed": args.run.seed, "busy": args.busy, "commander_lease_s": args.run.robot.commander_lease_s}
        args.json.write_bytes(bench_json("stop", stop_figures(figures), machine_facts(), settings))
        console.print(f"figures: {args.json}", soft_wrap=True)
    return 0 if holds_the_bar(figures) else EXIT_BELOW_BAR


def holds_the_bar(figures: StopFigures) -> bool:
    """Whether braking begins in time, and never for nothing."""
    in_time = all(percentile_s(stops, 99.0) <= BAR_S for stops in (figures.killed, figures.frozen) if stops)
    return in_time and figures.false_stops == 0


def stops_table(figures: StopFigures, busy: int) -> Table:
    """One row a fault."""
    table = Table(
        title=f"ms until braking begins, {busy} busy processes beside the system",
        caption=f"false stops: {figures.false_stops} in {figures.watched_s:.0f} s of motion",
    )
    for heading in ("the commander is", "n", "p50", "p99", "max", "stands after, max"):
        table.add_column(heading, justify="left" if heading.startswith("the") else "right")
    for name, stops in (("killed", figures.killed), ("frozen", figures.frozen)):
        if stops:
            stood = [stop.stood_s for stop in stops]
            longest = "never" if None in stood else _ms(max(value for value in stood if value is not None))
            cells = [_ms(percentile_s(stops, percent)) for percent in (50.0, 99.0, 100.0)]
            table.add_row(name, str(len(stops)), *cells, longest)
    return table


def _ms(seconds: float) -> str:
    return "never" if seconds == float("inf") else f"{seconds * 1e3:.0f}"


COMMAND = Command(StopBenchArgs, run_stop_bench)
