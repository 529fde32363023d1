"""How soon the arm brakes when its commander fails, and whether an operator's stop holds."""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dlokit.app.environment import prepare_environment

prepare_environment()  # before anything below imports MuJoCo or NumPy's linear algebra

from dlokit.app.commands import flag
from dlokit.app.console import say
from dlokit.app.operate import enable, stop
from dlokit.benches.report import bench_json, check_json_path
from dlokit.communication.timing.urgency import garbage_frozen
from dlokit.errors import EXIT_OTHERWISE, ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.processes.running import RunningSystem
from dlokit.system.results.run_record import machine_facts
from parts.command import run_study
from parts.stops.figures import confirmed_percentile_s, percentile_s, press_figures, stop_figures
from parts.stops.press_verdict import PressRow
from parts.stops.presses import Person, PressPlan, measure_presses
from parts.stops.stopping import StopFigures, StopPlan, measure_stops

BAR_S = 0.25
"""Limit on the time until braking begins, for 99 of 100 faults [s]."""
CONFIRMED_WITHIN_S = 1.0
"""Limit on the time until an operator's stop is confirmed, for 99 of 100 stops [s]."""
NOT_MEASURED = StopFigures()


@dataclass(frozen=True, kw_only=True)
class Args:
    """Kill and freeze the commander of a moving arm at random times on a busy machine, cut its feedback, press stop.

    Cell, robot and commander are processes of this machine. Times are measured on its monotonic clock, from the fault
    until the arm reports that it brakes, at 50 Hz. The bench then counts how often the arm brakes without any fault.

    An operator's stop is pressed at random moments of seven cases: the system starts, the commander is frozen, it is
    killed, `robot.recover` runs, between two motions, the fingers close, the DLO is carried. For each case the bench
    measures the time until feedback confirms the stop, and how far joints and fingers move afterwards, while the
    commander tries to move, grip and recover. Then the arm is enabled and must move.

    Exit code 0: braking begins within 0.25 s (p99) and never without a fault; a stop is confirmed within 1 s (p99),
    nothing moves after it (0.02 rad, 0.5 mm) and every command is rejected. 3: otherwise.
    """

    kills: int = 100
    """Number of times the commander is killed (SIGKILL)."""
    freezes: int = 100
    """Number of times the commander is frozen (SIGSTOP); it is resumed afterwards."""
    feedback_losses: int = 100
    """Number of times the driver gets no feedback of its arm, and of times another arm in the cell falls silent."""
    quiet_s: float = 600.0
    """Duration of motion without any fault [s]."""
    presses: int = 20
    """Number of stops by an operator in each of the seven cases; 0 omits them."""
    busy: int = 4
    """Number of processes that load the machine during the measurements."""
    json: Annotated[Path | None, flag("FILE")] = None
    """Also write all figures to this JSON file."""
    run: Annotated[RunConfig, tyro.conf.arg(name="")] = field(default_factory=RunConfig)
    """Settings of the system, e.g. --robot.commander-lease-s; --seed determines the times of the faults."""


def run(args: Args) -> int:
    """Measure and print."""
    counts = (args.kills, args.freezes, args.feedback_losses, args.presses, args.busy)
    if min(counts) < 0 or not 0.0 <= args.quiet_s < math.inf:
        raise ConfigError(
            "--kills, --freezes, --feedback-losses, --presses, --busy and --quiet-s must be 0 or greater."
        )
    check_json_path(args.json)
    console = Console()
    with console.status("starting") as status:
        said = status.update if console.is_terminal else console.print
        figures, rows = asyncio.run(_measure(args, said))
    if figures != NOT_MEASURED:
        console.print(stops_table(figures, args.busy))
    if rows:
        console.print(presses_table(rows, args.busy))
    if args.json is not None:
        settings = {"seed": args.run.seed, "busy": args.busy, "commander_lease_s": args.run.robot.commander_lease_s}
        all_figures = [*stop_figures(figures), *press_figures(rows)]
        args.json.write_bytes(bench_json("stop", all_figures, machine_facts(), settings))
        say(console, f"figures: {args.json}")
    return 0 if holds_the_bar(figures) and stops_hold(rows) else EXIT_OTHERWISE


async def _measure(args: Args, said: Callable[[str], None]) -> tuple[StopFigures, tuple[PressRow, ...]]:
    run = replace(args.run, runtime="live", headless=True, arms=1)
    figures, rows = NOT_MEASURED, tuple[PressRow, ...]()
    if args.kills or args.freezes or args.feedback_losses or args.quiet_s:
        plan = StopPlan(
            run=run,
            kills=args.kills,
            freezes=args.freezes,
            feedback_losses=args.feedback_losses,
            quiet_s=args.quiet_s,
            busy_processes=args.busy,
            seed=args.run.seed,
        )
        figures = await measure_stops(plan, said)
    if args.presses:
        presses = PressPlan(run=run, presses=args.presses, busy_processes=args.busy, seed=args.run.seed)
        async with garbage_frozen():  # garbage collection in the bench would count as latency of the arm
            rows = await measure_presses(presses, PERSON, said)
    return figures, rows


async def _stop(system: RunningSystem, say: Callable[[str], None]) -> int:
    return stop.exit_code(await stop.stop_all([system], say=say))


async def _enable(system: RunningSystem) -> int:
    return enable.exit_code(await enable.enable_all(system, stop.arms_of(Path(system.folder))))


PERSON = Person(stop=_stop, enable=_enable)
"""The commands that the bench measures: `dlokit stop` and `dlokit enable`."""


def holds_the_bar(figures: StopFigures) -> bool:
    """Whether braking begins in time, and never without a fault."""
    in_time = all(percentile_s(stops, 99.0) <= BAR_S for stops in figures.by_fault.values())
    return in_time and figures.false_stops == 0


def stops_hold(rows: Sequence[PressRow]) -> bool:
    """Whether each of the operator's stops is confirmed in time, and nothing moves until the arm is enabled."""
    return all(confirmed_percentile_s(row.presses, 99.0) <= CONFIRMED_WITHIN_S and row.wrong == 0 for row in rows)


def presses_table(rows: Sequence[PressRow], busy: int) -> Table:
    """The table of an operator's stops, one row per case."""
    table = Table(
        title=f"ms until an operator's stop is confirmed, {busy} busy processes beside the system",
        caption="moved, fingers: largest movement after the confirmation; wrong: stops that did not hold",
    )
    headings = ("stop while", "n", "p50", "p99", "max", "moved rad", "fingers mm", "wrong")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == headings[0] else "right")
    for row in rows:
        cells = [_ms(confirmed_percentile_s(row.presses, percent)) for percent in (50.0, 99.0, 100.0)]
        moved = (f"{row.moved_rad:.4f}", f"{row.fingers_m * 1e3:.2f}")
        table.add_row(row.name, str(len(row.presses)), *cells, *moved, str(row.wrong))
    return table


def stops_table(figures: StopFigures, busy: int) -> Table:
    """The table of braking times, one row per fault."""
    table = Table(
        title=f"ms until braking begins, {busy} busy processes beside the system",
        caption=f"false stops: {figures.false_stops} in {figures.watched_s:.0f} s of motion",
    )
    for heading in ("the fault", "n", "p50", "p99", "max", "at rest after, max"):
        table.add_column(heading, justify="left" if heading.startswith("the") else "right")
    for name, stops in figures.by_fault.items():
        stood = [stop.stood_s for stop in stops]
        longest = "never" if None in stood else _ms(max(value for value in stood if value is not None))
        cells = [_ms(percentile_s(stops, percent)) for percent in (50.0, 99.0, 100.0)]
        table.add_row(name, str(len(stops)), *cells, longest)
    return table


def _ms(seconds: float) -> str:
    return "never" if seconds == float("inf") else f"{seconds * 1e3:.0f}"


if __name__ == "__main__":
    run_study(Args, run, None)
