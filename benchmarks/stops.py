"""How soon an arm brakes when its commander or its feedback is lost, and whether a person's stop holds.

    python benchmarks/stops.py
    python benchmarks/stops.py --presses 0 --quiet-s 0 --json stops.json

Cell, robot and commander are processes of this machine, beside busy ones. Times are measured on its monotonic clock,
from the fault until the arm reports that it brakes, at 50 Hz. It also counts how often the arm brakes without a fault.

A person's stop is pressed at random moments of seven cases: the system starts, the commander is frozen, it is killed,
`robot.recover` runs, between two motions, the fingers close, the DLO is carried. Measured are the time until feedback
confirms the stop, and how far joints and fingers move afterwards, while the commander tries to move, grip and recover.
Then the arm is enabled and must move.

Exit code 0: braking begins within 0.25 s (p99) and never without a fault; a stop is confirmed within 1 s (p99), nothing
moves after it (0.02 rad, 0.5 mm) and every command is rejected. 3: otherwise.
"""

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from dlokit.app.environment import prepare_environment
from dlokit.communication.timing.urgency import garbage_frozen
from dlokit.errors import EXIT_OTHERWISE, ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from parts.command import check_json, count_in, figures_table, run_study, value_in, write_figures
from parts.stops.braking import FROZEN, KILLED, SILENT, WITHHELD, Braking, measure_braking
from parts.stops.press_verdict import Press
from parts.stops.presses import measure_presses

BAR_S = 0.25
"""Limit on the time until braking begins, for 99 of 100 faults [s]."""
CONFIRMED_WITHIN_S = 1.0
"""Limit on the time until a person's stop is confirmed, for 99 of 100 stops [s]."""
PERCENTILES = {"p50": 50.0, "p99": 99.0, "max": 100.0}
BEGINS, STANDS, CONFIRMED = "braking begins after", "at rest after", "confirmed after"


@dataclass(frozen=True, kw_only=True)
class Args:
    """Kill and freeze the commander of a moving arm at random times on a busy machine, cut its feedback, press stop."""

    kills: int = 100
    """Number of times the commander is killed (SIGKILL)."""
    freezes: int = 100
    """Number of times the commander is frozen (SIGSTOP); it is resumed afterwards."""
    feedback_losses: int = 100
    """Number of times the driver gets no feedback of its arm, and of times another arm in the cell falls silent."""
    quiet_s: float = 600.0
    """Duration of motion without any fault [s]."""
    presses: int = 20
    """Number of stops by a person in each of the seven cases; 0 omits them."""
    busy: int = 4
    """Number of processes that load the machine during the measurements."""
    seed: int = 0
    """Determines the times of faults and stops."""
    json: Path | None = None
    """Also write all figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 3 where an arm or a stop was not as it should be."""
    counts = (args.kills, args.freezes, args.feedback_losses, args.presses, args.busy)
    if min(counts) < 0 or not 0.0 <= args.quiet_s < math.inf:
        raise ConfigError(
            "--kills, --freezes, --feedback-losses, --presses, --busy and --quiet-s must be 0 or greater."
        )
    check_json(args.json)
    prepare_environment()  # of the processes that are started
    console = Console()
    braking, presses = asyncio.run(_measured(args, lambda line: console.print(line, markup=False, soft_wrap=True)))
    of_braking, of_presses = braking_figures(braking), press_figures(presses)
    _print(console, args, of_braking, of_presses)
    write_figures(args.json, "stops", [*of_braking, *of_presses], {"seed": args.seed, "busy": args.busy}, console)
    return 0 if holds_the_bar(braking) and stops_hold(presses) else EXIT_OTHERWISE


async def _measured(args: Args, said: Callable[[str], None]) -> tuple[Braking, dict[str, list[Press]]]:
    times = {KILLED: args.kills, FROZEN: args.freezes, WITHHELD: args.feedback_losses, SILENT: args.feedback_losses}
    braking = await measure_braking(times, args.quiet_s, args.busy, args.seed, said)
    if not args.presses:
        return braking, {}
    async with garbage_frozen():  # garbage collection in the study would count as latency of the arm
        return braking, await measure_presses(args.presses, args.busy, args.seed, said)


def percentile_s(times_s: Sequence[float | None], percent: float) -> float:
    """The time [s] that this many percent of the times did not exceed; None, which counts as inf, never came.

    It is one of the times, not between two: with 100 of them the 99th percentile is the second longest.
    """
    times = sorted(math.inf if time_s is None else time_s for time_s in times_s)
    return times[max(math.ceil(percent / 100.0 * len(times)) - 1, 0)]


def holds_the_bar(braking: Braking) -> bool:
    """Whether braking begins in time, and never without a fault."""
    began = ([stop.began_s for stop in stops] for stops in braking.by_fault.values())
    return braking.false_stops == 0 and all(percentile_s(times_s, 99.0) <= BAR_S for times_s in began)


def stops_hold(presses: Mapping[str, Sequence[Press]]) -> bool:
    """Whether each of the person's stops is confirmed in time, and nothing moves until the arm is enabled."""
    in_time = (percentile_s([press.confirmed_s for press in row], 99.0) for row in presses.values())
    wrong = any(press.wrong for row in presses.values() for press in row)
    return not wrong and all(time_s <= CONFIRMED_WITHIN_S for time_s in in_time)


def braking_figures(braking: Braking) -> list[BenchFigure]:
    """Rows for the JSON file; an arm that never braked has no time but in the count."""
    figures: list[BenchFigure] = []
    for case, stops in braking.by_fault.items():
        figures += _times(case, "never braked", BEGINS, [stop.began_s for stop in stops])
        figures += _times(case, "never at rest", STANDS, [stop.stood_s for stop in stops])
    figures.append(_figure("quiet", "false stops", braking.false_stops, 1))
    figures.append(_figure("quiet", "time watched", braking.watched_s, 1, "s"))
    return figures


def press_figures(presses: Mapping[str, Sequence[Press]]) -> list[BenchFigure]:
    """Rows for the JSON file; a stop that was never confirmed has no time but in the count."""
    figures: list[BenchFigure] = []
    for name, row in presses.items():
        case, n = f"stop: {name}", len(row)
        figures += _times(case, "never confirmed", CONFIRMED, [press.confirmed_s for press in row])
        figures.append(_figure(case, "joints moved after, max", max(press.moved_rad for press in row), n, "rad"))
        figures.append(_figure(case, "fingers moved after, max", max(press.fingers_m for press in row), n, "m"))
        figures.append(_figure(case, "wrong", sum(bool(press.wrong) for press in row), n))
    return figures


def _times(case: str, never: str, what: str, times_s: Sequence[float | None]) -> list[BenchFigure]:
    found = {f"{what}, {name}": percentile_s(times_s, percent) for name, percent in PERCENTILES.items()}
    n = len(times_s)
    return [
        _figure(case, never, sum(time_s is None for time_s in times_s), n),
        *(_figure(case, name, value_s, n, "s") for name, value_s in found.items() if math.isfinite(value_s)),
    ]


def _figure(case: str, metric: str, value: float, n: int, unit: str = "1") -> BenchFigure:
    return figure(case, "dlokit", metric, without_interval(value, n), unit)


def _print(console: Console, args: Args, braking: Sequence[BenchFigure], presses: Sequence[BenchFigure]) -> None:
    """Print a table of the faults, and one of the person's stops."""
    of_faults = [one for one in braking if one.case != "quiet"]
    false_stops, watched_s = (one.value for one in braking if one.case == "quiet")
    beside = f"{args.busy} busy processes beside the system; ms"
    if of_faults:
        columns = {"n": count_in("never braked")}
        columns |= {name: value_in(f"{BEGINS}, {name}", 1e3) for name in PERCENTILES}
        columns |= {"at rest after, max": value_in(f"{STANDS}, max", 1e3)}
        console.print(figures_table("braking begins after", beside, of_faults, columns))
    console.print(f"braked without a fault: {false_stops:.0f} times in {watched_s:.0f} s of motion")
    if presses:
        columns = {"n": count_in("never confirmed")}
        columns |= {name: value_in(f"{CONFIRMED}, {name}", 1e3) for name in PERCENTILES}
        columns |= {"moved rad": value_in("joints moved after, max", digits=4)}
        columns |= {"fingers mm": value_in("fingers moved after, max", 1e3, 2), "wrong": value_in("wrong")}
        console.print(figures_table("a person's stop is confirmed after", beside, presses, columns))


if __name__ == "__main__":
    run_study(Args, run, __doc__)
