"""How long it takes in a live run from the exposure of a pair of pictures to the decision, hop by hop.

    python benchmarks/latency.py
    python benchmarks/latency.py --start I --goal S --limit-s 120 --json latency.json

Starts `dlokit shape` live, listens on its bus as a viewer does, and notes when each message was sent: pictures, cloud,
target points, state, step of the decision layer. Prints the machine's time of each hop: median, 95 % quantile, largest.
The run ends by itself or after --limit-s; what was received by then is counted.
"""

import asyncio
import itertools
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit.communication import topics
from dlokit.communication.container import end_tasks
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Transport
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from dlokit.types.message import Message
from parts.command import check_json, run_study, write_figures
from parts.live_run import StartedCommand, live_run

T = TypeVar("T", bound=Message)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Time a live run from the exposure of each pair of pictures to the decision, hop by hop."""

    start: str = "I"
    """Start shape of the DLO, as `dlokit shape --start` takes it."""
    goal: str = "S"
    """Goal shape."""
    seed: int = 0
    """Seed of the run."""
    limit_s: float = 600.0
    """The run is ended this long after its start [s]."""
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Run, listen and print; exit code 0."""
    if not args.limit_s > 0.0:
        raise ConfigError(f"--limit-s is {args.limit_s}; it must be above 0.")
    check_json(args.json)
    console = Console()
    with tempfile.TemporaryDirectory(prefix="dlokit-latency-") as folder, console.status("a live run starts") as status:
        said = status.update if console.is_terminal else console.print
        found = hops(asyncio.run(_heard(args, Path(folder), said)))
    console.print(_table(found))
    config = {"start": args.start, "goal": args.goal, "seed": args.seed}
    write_figures(args.json, "latency", _figures(found), config, console)
    return 0


async def _heard(args: Args, folder: Path, said: Callable[[str], object]) -> "Sent":
    task = ("--start", args.start, "--goal", args.goal, "--seed", str(args.seed))
    run_dir = folder / "run"
    program = StartedCommand(
        arguments=("shape", "--runtime", "live", "--headless", *task, "--out", str(run_dir)),
        output=folder / "log.txt",
    )
    async with live_run(program, run_dir) as live:
        said(f"{args.start} to {args.goal} is shaped, for at most {args.limit_s:g} s")
        return await listen(live.bus.transport, program.ends_within(args.limit_s))


EXPOSURE, PICTURES, CLOUD, TARGETS, STATE, DECISION = (
    "exposure",
    "pictures",
    "cloud",
    "targets",
    "state",
    "decision",
)
STATIONS = (EXPOSURE, PICTURES, CLOUD, TARGETS, STATE, DECISION)
WHOLE_WAY = (EXPOSURE, DECISION)


@dataclass
class Sent:
    """When messages of a run were sent, on the machine's monotonic clock [s]."""

    ticks: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])
    """Stamps of the cell's clock [ns], in order, and when they were sent."""
    by_exposure: dict[str, dict[int, float]] = field(default_factory=dict[str, dict[int, float]])
    """By station, but for the exposure itself and the decision: the first message that speaks of an exposure [ns]."""
    decisions_s: list[float] = field(default_factory=list[float])
    """When the decision layer told of a step."""

    def note(self, station: str, exposure_ns: int, sent_s: float) -> None:
        """A message that speaks of an exposure; the first one counts."""
        self.by_exposure.setdefault(station, {}).setdefault(exposure_ns, sent_s)


def hops(sent: Sent) -> dict[tuple[str, str], list[float]]:
    """Seconds of each hop, by the stations that it joins, and of the whole way; one a look that came so far."""
    looks = looks_of(sent)
    found: dict[tuple[str, str], list[float]] = {}
    for pair in (*itertools.pairwise(STATIONS), WHOLE_WAY):
        found[pair] = [look[pair[1]] - look[pair[0]] for look in looks if pair[0] in look and pair[1] in look]
    return found


def looks_of(sent: Sent) -> list[dict[str, float]]:
    """For each exposure, in order, when it had come to each station."""
    exposures = sorted({exposure for by_exposure in sent.by_exposure.values() for exposure in by_exposure})
    looks: list[dict[str, float]] = []
    for exposure_ns in exposures:
        look = {station: times[exposure_ns] for station, times in sent.by_exposure.items() if exposure_ns in times}
        exposed_s = machine_time_s(exposure_ns, sent.ticks)
        if exposed_s is not None:
            look[EXPOSURE] = exposed_s
        looks.append(look)
    _decide(looks, sorted(sent.decisions_s))
    return looks


def machine_time_s(stamp_ns: int, ticks: Sequence[tuple[int, float]]) -> float | None:
    """When the cell's clock showed a stamp, on the machine's [s]; None outside of the ticks that were heard."""
    if not ticks or not ticks[0][0] <= stamp_ns <= ticks[-1][0]:
        return None
    stamps, sent_s = zip(*ticks, strict=True)
    return float(np.interp(stamp_ns, stamps, sent_s))


def _decide(looks: Sequence[dict[str, float]], decisions_s: Sequence[float]) -> None:
    """A look is decided upon by the first step that is told after its state, and before the next one's."""
    decided = [look for look in looks if STATE in look]
    until = [later[STATE] for later in decided[1:]] + [np.inf] * bool(decided)
    for look, until_s in zip(decided, until, strict=True):
        after = [time_s for time_s in decisions_s if look[STATE] < time_s <= until_s]
        if after:
            look[DECISION] = after[0]


def named(pair: tuple[str, str]) -> str:
    """A hop in words."""
    return f"{pair[0]} → {pair[1]}"


Hops = Mapping[tuple[str, str], Sequence[float]]


async def listen(transport: Transport, wait: Awaitable[object]) -> Sent:
    """Note when each message was sent, as a viewer receives them, until `wait` is over."""
    sent = Sent()

    async def hear(topic: Topic[T], note: Callable[[T, float], None]) -> None:
        stream = transport.stream(topic)
        async for message in stream:
            note(message, asyncio.get_running_loop().time() - stream.age_s)

    tasks = (
        asyncio.create_task(hear(topics.CLOCK, lambda tick, sent_s: sent.ticks.append((tick.stamp_ns, sent_s)))),
        asyncio.create_task(hear(topics.FLOW, lambda status, sent_s: sent.decisions_s.append(sent_s))),
        asyncio.create_task(hear(topics.STEREO_IMAGES, lambda seen, at_s: sent.note(PICTURES, seen.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.OBSERVATION, lambda seen, at_s: sent.note(CLOUD, seen.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.TARGETS, lambda found, at_s: sent.note(TARGETS, found.stamp_ns, at_s))),
        asyncio.create_task(hear(topics.STATE, lambda state, at_s: sent.note(STATE, state.observed_stamp_ns, at_s))),
    )
    try:
        await wait
    finally:
        await end_tasks(*tasks)
    return sent


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


if __name__ == "__main__":
    run_study(Args, run, __doc__)
