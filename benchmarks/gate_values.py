"""Whether anything adversarial moves an arm outside its limits: values at the gate, and calls of whole skills.

    python benchmarks/gate_values.py --values 100000 --calls 1000 --seed 0

Values are tried at the gate alone, with an arm that notes what it is given. Each is refused when it is made, refused by
name, or kept to the limits by differences of the set-points that the cell's own program makes of it. Calls go over the
bus of one process to the robot component, its gate, and the simulated cell in lockstep; the set-points of each physics
step are compared with the limits, and what succeeded with what was asked for. Exit code 3 when a bar is missed.

Planning is the machine's time from the call to the order to the driver, or to the refusal, less the cell's physics.
Memory is the rise of the process's resident memory above its level before the call, at its highest (Linux alone); in
every hundredth call also the peak that tracemalloc counts, and that call's time is not counted, which tracemalloc
doubles.
"""

import asyncio
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

# Shared with the tests, which import them in the same way; the package has no use for them.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from adversarial import MUTATIONS, executed_breach, honest, honest_pose, remade, spoilt_pose, spoilt_profile
from adversarial_calls import Batch, CallResult
from robot_bench import KINEMATICS, PerfectArm

from dlokit.communication.timing import virtual_time
from dlokit.description.arm.franka import PANDA
from dlokit.errors import BadValue, CommunicationError, SkillFailure
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import GripResult, JointTrajectory, Lease, MotionResult
from parts.command import check_json, run_study, write_figures

LONGEST_S, MOST_MIB = 1.0, 256.0
MISSED = 3
"""Exit code when a bar is missed."""
TRACED_EACH = 100
BASES, MOST_SAMPLES = 200, 250
"""Honest motions that mutations start from; longer ones take long to judge, and repeat themselves."""
CALLS_PER_CELL = 50
PIECES = 5
"""Set-points that are compared between two samples of a motion that passed."""
SHARES = {"as planned": 0.1, "speeds": 0.2}
"""Of the values, where not 1: what costs much time and is mostly the same."""
CONFIG, LEASE = GateConfig(), Lease(holder="benchmark")
Rng = np.random.Generator


@dataclass
class Tally:
    """What became of the values or calls of one kind."""

    tried: int = 0
    refused_when_made: int = 0
    refused: Counter[str] = field(default_factory=Counter[str])
    """By reason."""
    executed: int = 0
    succeeded: int = 0
    """Of the calls."""
    broken: list[str] = field(default_factory=list[str])
    """What was executed outside a limit."""
    wrong: list[str] = field(default_factory=list[str])
    """Successes that were none, and ends without a name."""
    slowest_s: float = 0.0
    largest_mib: float = 0.0

    @property
    def passes(self) -> bool:
        """Whether all of it is inside the bars."""
        return not self.broken and not self.wrong and self.slowest_s <= LONGEST_S and self.largest_mib <= MOST_MIB


class NotingArm(PerfectArm):
    """Stands where each motion begins, and takes no time for it, however long it is."""

    gripped = 0

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Count it."""
        self.gripped += 1
        self.width_m = width_m
        return GripResult(width_m=width_m, held=False)

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Note it."""
        self.followed.append(trajectory)
        return MotionResult(
            q_rad=self.q, T_world_tcp=KINEMATICS.forward(self.q), duration_s=0.0, largest_joint_error_rad=0.0
        )


class Memory:
    """The rise of resident memory [MiB] since `begin`, at its highest; and what tracemalloc counts, now and then."""

    def __init__(self) -> None:
        self._count = 0
        self._before_kib = 0

    @property
    def traced(self) -> bool:
        """Whether this call is one that tracemalloc slows down."""
        return self._count % TRACED_EACH == 0

    def begin(self) -> None:
        """Start counting."""
        self._count += 1
        if self.traced:
            tracemalloc.start()
        # Linux sets the high-water mark back to what is resident now.
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        self._before_kib = _status_kib("VmRSS")

    def end_mib(self) -> float:
        """The rise [MiB]."""
        rise = (_status_kib("VmHWM") - self._before_kib) / 1024.0
        if self.traced:
            rise = max(rise, tracemalloc.get_traced_memory()[1] / 2**20)
            tracemalloc.stop()
        return rise


def _status_kib(name: str) -> int:
    with open("/proc/self/status", encoding="ascii") as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith(name))


@contextmanager
def measured(tally: Tally, memory: Memory) -> Generator[None, None, None]:
    """Note the time and the memory of one value."""
    memory.begin()
    began_s = time.perf_counter()
    try:
        yield
    finally:
        seconds = time.perf_counter() - began_s
        tally.largest_mib = max(tally.largest_mib, memory.end_mib())
        if not memory.traced:
            tally.slowest_s = max(tally.slowest_s, seconds)


class AtGate:
    """Tries values at a gate, before an arm that notes what passes."""

    def __init__(self, seed: int) -> None:
        self._arm = NotingArm()
        self._robot = GatedRobot(self._arm, CONFIG, lambda: round(asyncio.get_running_loop().time() * 1e9))
        self._rng = np.random.default_rng(seed)
        self._bases = _bases(seed)
        self._memory = Memory()

    async def run(self, values: int, told: Callable[[int], None]) -> dict[str, Tally]:
        """Tallies by kind."""
        kinds = [*MUTATIONS, *OTHERS]
        shares = np.array([SHARES.get(kind, 1.0) for kind in kinds])
        shares /= shares.sum()
        tallies = {kind: Tally() for kind in kinds}
        async with self._robot:
            for number in range(values):
                kind = str(self._rng.choice(kinds, p=shares))
                await self._try(kind, tallies[kind])
                if number % 1000 == 0:
                    told(number)
        return tallies

    async def _try(self, kind: str, tally: Tally) -> None:
        base = self._bases[int(self._rng.integers(len(self._bases)))]
        self._arm.followed.clear()
        self._arm.q, self._arm.width_m, self._arm.gripped = base.q_rad[0], 0.08, 0
        tally.tried += 1
        try:
            with measured(tally, self._memory), np.errstate(all="ignore"):
                await self._send(kind, base)
        except (BadValue, CommunicationError):
            tally.refused_when_made += 1
        except SkillFailure as failure:
            tally.refused[failure.reason] += 1
        except Exception as error:  # whatever it is, it is no named refusal
            tally.wrong.append(f"{kind}: {type(error).__name__}: {error}")
        self._judge(kind, tally)

    async def _send(self, kind: str, base: JointTrajectory) -> None:
        if kind in OTHERS:
            await OTHERS[kind](self._robot, base, self._rng)
            return
        made = MUTATIONS[kind](base, self._rng)
        # The arm stands where the motion starts, so that it is not refused for that alone; most of the time.
        if made.q_rad.shape[1:] == (7,) and len(made.q_rad) and self._rng.random() < 0.95:
            first = made.q_rad[0]
            self._arm.q = np.clip(first, PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad)
        await self._robot.follow(made, LEASE)

    def _judge(self, kind: str, tally: Tally) -> None:
        tally.executed += self._arm.gripped
        for run in self._arm.followed:
            tally.executed += 1
            breach = executed_breach(run, CONFIG, PIECES)
            if breach:
                tally.broken.append(f"{kind}: {breach}")
        if not 0.0 <= self._arm.width_m <= 0.08:
            tally.broken.append(f"{kind}: fingers at {self._arm.width_m} m")


def _bases(seed: int) -> list[JointTrajectory]:
    found: list[JointTrajectory] = []
    number = seed * 1_000_003
    while len(found) < BASES:
        number += 1
        try:
            motion = honest(number)
        except SkillFailure:
            continue
        if len(motion.times_s) <= MOST_SAMPLES:
            found.append(motion)
    return found


async def _poses(robot: GatedRobot, base: JointTrajectory, rng: Rng) -> None:
    """A pose, planned to from where the arm is."""
    chance = rng.random()
    pose = spoilt_pose(rng) if chance < 0.7 else honest_pose(rng)
    if chance > 0.85:
        pose.position_m[rng.integers(3)] += rng.normal() * 10 ** rng.uniform(-2.0, 3.0)
    await robot.follow(joint_move(base.q_rad[0], KINEMATICS.inverse(remade(pose), base.q_rad[0]), PANDA.limits), LEASE)


async def _speeds(robot: GatedRobot, base: JointTrajectory, rng: Rng) -> None:
    """A velocity profile, for a line to a near pose."""
    if rng.random() < 0.8:
        profile = remade(spoilt_profile(rng))
    else:
        v, a, j = 10 ** rng.uniform(-8.0, 8.0, 3)
        profile = VelocityProfile(speed_m_s=v, acceleration_m_s2=a, jerk_m_s3=j)
    await robot.follow(tool_move(KINEMATICS, base.q_rad[0], (honest_pose(rng),), profile), LEASE)


async def _grips(robot: GatedRobot, base: JointTrajectory, rng: Rng) -> None:
    odd = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1e-9, 1e-300, 0.08, 0.0800001, 70.0, 70.001, 1e308)
    width_m, force_n = (
        float(rng.choice(odd)) if rng.random() < 0.5 else float(rng.normal() * largest) for largest in (0.08, 70.0)
    )
    await robot.grip(width_m, force_n, LEASE)


async def _leases(robot: GatedRobot, base: JointTrajectory, rng: Rng) -> None:
    holder = str(rng.choice(["", "benchmark"]))
    duration_s = float(rng.choice([np.nan, np.inf, -np.inf, 0.0, -1.0, 0.2, 1e-300]))
    await robot.follow(base, Lease(holder=holder, duration_s=duration_s))


OTHERS = {"poses": _poses, "speeds": _speeds, "grips": _grips, "leases": _leases}


def calls_in_lockstep(calls: int, seed: int, told: Callable[[int], None], used: dict[str, float]) -> dict[str, Tally]:
    """Tallies by skill; a new cell after every few calls. `used` gets the largest fraction of each limit."""
    tallies: dict[str, Tally] = {}
    memory = Memory()

    def note(result: CallResult) -> None:
        tally = tallies.setdefault(result.kind, Tally())
        tally.tried += 1
        tally.refused_when_made += result.refused_when_made
        if result.reason and not result.refused_when_made:
            tally.refused[result.reason] += 1
        tally.executed += result.moved
        tally.succeeded += not result.reason
        tally.broken += [f"{result.kind}: {breach}" for breach in result.broken]
        tally.wrong += [f"{result.kind}: {wrong}" for wrong in result.wrong]
        tally.largest_mib = max(tally.largest_mib, result.largest_mib)
        if not memory.traced:
            tally.slowest_s = max(tally.slowest_s, result.planning_s)

    for begin in range(0, calls, CALLS_PER_CELL):
        told(begin)
        batch = Batch(np.random.default_rng((seed, begin)), memory.begin, memory.end_mib, CONFIG)
        virtual_time.run(batch.run(min(CALLS_PER_CELL, calls - begin), note))
        for what, fraction in batch.used.items():
            used[what] = max(used.get(what, 0.0), fraction)
    return dict(sorted(tallies.items()))


def print_tallies(console: Console, title: str, tallies: dict[str, Tally]) -> None:
    """One row a kind, and their sum."""
    table = Table(title=title)
    columns = (
        "kind",
        "tried",
        "refused when made",
        "refused by name",
        "executed",
        "succeeded",
        "broke a limit",
        "false success",
    )
    for column in (*columns, "slowest planning [s]", "largest memory [MiB]"):
        table.add_column(column, justify="left" if column == "kind" else "right")
    total = Tally()
    for kind, tally in tallies.items():
        _add_row(table, kind, tally)
        total.tried += tally.tried
        total.refused_when_made += tally.refused_when_made
        total.refused += tally.refused
        total.executed += tally.executed
        total.succeeded += tally.succeeded
        total.broken += tally.broken
        total.wrong += tally.wrong
        total.slowest_s = max(total.slowest_s, tally.slowest_s)
        total.largest_mib = max(total.largest_mib, tally.largest_mib)
    _add_row(table, "all", total)
    console.print(table)
    console.print("refused by name: " + ", ".join(f"{reason} {count}" for reason, count in total.refused.most_common()))
    for text in (*total.broken[:20], *total.wrong[:20]):
        console.print(text[:400], style="red")


def _add_row(table: Table, kind: str, tally: Tally) -> None:
    counts = (tally.tried, tally.refused_when_made, tally.refused.total(), tally.executed, tally.succeeded)
    failed = (len(tally.broken), len(tally.wrong))
    sizes = (f"{tally.slowest_s:.3f}", f"{tally.largest_mib:.1f}")
    table.add_row(kind, *(str(count) for count in (*counts, *failed)), *sizes)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Try values at the gate, and calls of whole skills in lockstep; the same ones for the same seed."""

    values: int = 100_000
    """Values tried at the gate alone."""
    calls: int = 1_000
    """Calls of skills over the bus of one process."""
    seed: int = 0
    """Seed of both."""
    json: Path | None = None
    """Also write every count to this file."""


def run(args: Args) -> int:
    """Try and print; exit code 3 when a bar is missed."""
    check_json(args.json)
    values, calls, seed = args.values, args.calls, args.seed
    console = Console(width=150)

    def told(what: str, all_of: int) -> Callable[[int], None]:
        return lambda done: print(f"{what}: {done} of {all_of}", file=sys.stderr)

    async def at_gate() -> dict[str, Tally]:
        return await AtGate(seed).run(values, told("values", values))

    used: dict[str, float] = {}
    parts: dict[str, dict[str, Tally]] = {}
    parts[f"{values} values at the gate, seed {seed}"] = virtual_time.run(at_gate()) if values else {}
    parts[f"{calls} calls in lockstep, seed {seed}"] = calls_in_lockstep(calls, seed, told("calls", calls), used)
    missed = False
    for title, tallies in parts.items():
        print_tallies(console, title, tallies)
        missed = missed or not all(tally.passes for tally in tallies.values())
    rows = [row for tallies in parts.values() for kind, tally in tallies.items() for row in _figures(kind, tally)]
    write_figures(args.json, "gate_values", rows, {"values": values, "calls": calls, "seed": seed}, console)
    console.print("a bar is missed" if missed else "all bars are kept")
    if calls:
        console.print("most used of a limit in lockstep: " + ", ".join(f"{k} {v:.3f}" for k, v in used.items()))
    return MISSED if missed else 0


def _figures(kind: str, tally: Tally) -> list[BenchFigure]:
    counts = {
        "refused when made": tally.refused_when_made,
        "refused by name": tally.refused.total(),
        "executed": tally.executed,
        "succeeded": tally.succeeded,
        "broke a limit": len(tally.broken),
        "false success": len(tally.wrong),
    }
    return [
        figure(kind, "dlokit", metric, without_interval(float(count), tally.tried), "1")
        for metric, count in counts.items()
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
