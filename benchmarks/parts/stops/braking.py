"""How soon the arm brakes when its commander or its feedback is lost, and how often when nothing is wrong."""

import os
import signal
import tempfile
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from dlokit.errors import ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.table import SECOND
from dlokit.types.robot import RobotMode
from parts.arm_and_cell import arm_and_cell, burden
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import Disturbance, disturb, disturbed_process
from parts.logs import AT_REST
from parts.stops.commander import Commanded, to_and_fro

MOVES_WITHIN_S = 60.0
"""A commander that was thawed, or takes over, moves the arm long before."""
STARTS_WITHIN_S = 180.0
"""The first commander, whose process imports everything."""
BRAKES_WITHIN_S = 5.0
"""An arm that has not braked by then counts as one that never does."""
LATEST_S = 0.9
"""Faults come within this time of the beginning of a motion [s of the arm's clock], which takes 1.4 s at least."""


@dataclass(frozen=True, kw_only=True)
class ArmStop:
    """What became of the arm after one fault."""

    began_s: float | None
    """From the fault until the arm is heard to brake [s]; None: it never was."""
    stood_s: float | None
    """From the fault until it stands [s]."""


@dataclass(kw_only=True)
class Braking:
    """All that is measured."""

    by_fault: dict[str, tuple[ArmStop, ...]] = field(default_factory=dict[str, tuple[ArmStop, ...]])
    """Of each fault that was tried, by its name."""
    watched_s: float = 0.0
    """Time in which nothing was done to a commander in motion [s]."""
    false_stops: int = 0
    """How often the arm braked in that time."""


KILLED, FROZEN = "commander killed", "commander frozen"
WITHHELD = "feedback withheld"
"""Feedback of the arm, from its driver."""
SILENT = "other arm silent"
"""The process of another arm in the same cell is frozen."""


async def measure_braking(
    times: Mapping[str, int], quiet_s: float, busy: int, seed: int, said: Callable[[str], None]
) -> Braking:
    """Let each fault happen so many times, to cell, arms and commander as processes of this machine.

    First the arm moves without a fault for `quiet_s`. `said` hears how far it is.
    """
    found = Braking()
    alone = [name for name in (FROZEN, KILLED, WITHHELD) if times[name]]
    if quiet_s or alone:
        async with _trials(1, busy, seed, said) as trials:
            found.false_stops, found.watched_s = await trials.watch(quiet_s)
            for name in alone:
                found.by_fault[name] = await trials.after(name, times[name])
    if times[SILENT]:
        async with _trials(2, busy, seed, said) as trials:
            found.by_fault[SILENT] = await trials.after(SILENT, times[SILENT])
    return found


@asynccontextmanager
async def _trials(
    arms: Literal[1, 2], busy: int, seed: int, said: Callable[[str], None]
) -> AsyncGenerator["FaultTrials"]:
    """A system with so many arms, of which the first is commanded, beside so many busy processes."""
    run = RunConfig(runtime="live", headless=True, arms=arms, seed=seed)
    with tempfile.TemporaryDirectory(prefix="dlokit-stop-") as name:
        folder = Path(name)
        run_dir = folder / "run"
        run_dir.mkdir()
        async with arm_and_cell(run_dir, run, command=disturbed_process(folder / DISTURBANCE)) as live:
            trials = FaultTrials(Commanded(live), folder, seed, said)
            try:
                await trials.begin()
                with burden(busy):  # from here on: starting takes long enough without
                    yield trials
            finally:
                trials.commanded.kill()


class FaultTrials:
    """Faults of one system, whose processes read from a file in `folder` how their bus is disturbed."""

    def __init__(
        self,
        commanded: Commanded,
        folder: Path,
        seed: int,
        said: Callable[[str], None],
        brakes_within_s: float = BRAKES_WITHIN_S,
    ) -> None:
        """An arm that needs longer than `brakes_within_s` [s] to brake, and from there to rest, never does."""
        self.commanded = commanded
        self._folder = folder
        self._said = said
        self._brakes_within_s = brakes_within_s
        self._rng = np.random.default_rng(seed)

    async def begin(self) -> None:
        """Start the commander, and return when it moves the arm."""
        self.commanded.begin(to_and_fro)
        await self.moving(after_s=0.0, within_s=STARTS_WITHIN_S)

    async def after(self, name: str, times: int) -> tuple[ArmStop, ...]:
        """What became of the arm after a fault, each of so many times."""
        strike, mend = self._fault(name)
        stops: list[ArmStop] = []
        while len(stops) < times:
            stop = await self._struck(strike)
            mend()
            if stop is not None:
                stops.append(stop)
                self._said(f"{name}, {len(stops)} of {times}")
        return tuple(stops)

    async def watch(self, quiet_s: float) -> tuple[int, float]:
        """Let the arm move for a while; how often it braked, and for how long it was watched [s]."""
        before, began_s = self.commanded.log.brakings, time.monotonic()
        while (left_s := began_s + quiet_s - time.monotonic()) > 0.0:
            self._said(f"{left_s:.0f} s of quiet motion left; braked {self.commanded.log.brakings - before} times")
            await self.moving(after_s=time.monotonic())
        return self.commanded.log.brakings - before, time.monotonic() - began_s

    async def moving(self, *, after_s: float, within_s: float = MOVES_WITHIN_S) -> None:
        """Return when the arm has begun its next motion. Raises `ProcessFailure` when it does not."""
        if await self.commanded.log.until_mode(RobotMode.MOVING, after_s=after_s, within_s=within_s) is None:
            raise ProcessFailure("no_motion", f"the commander did not move the arm within {within_s:g} s")

    def _fault(self, name: str) -> tuple[Callable[[], None], Callable[[], None]]:
        """What begins a fault, and what ends it."""
        if name == KILLED:
            return self.commanded.kill, self.commanded.replace
        if name == FROZEN:
            return self.commanded.freeze, self.commanded.thaw
        if name == WITHHELD:
            change = partial(disturb, self._folder)
            return partial(change, Disturbance.NO_FEEDBACK), partial(change, Disturbance.NONE)
        other = self.commanded.live.supervisor.pids[SECOND.name]
        return partial(os.kill, other, signal.SIGSTOP), partial(os.kill, other, signal.SIGCONT)

    async def _struck(self, strike: Callable[[], None]) -> ArmStop | None:
        """At a random moment of a motion; None when the motion came to its end before anybody had to notice."""
        log = self.commanded.log
        while True:
            await self.moving(after_s=time.monotonic())
            await self.commanded.live.clock.sleep(float(self._rng.uniform(0.0, LATEST_S)))
            if log.mode is RobotMode.MOVING:  # and was not braked meanwhile
                break
        struck_s = time.monotonic()
        strike()
        interrupted, began_s = await log.braked(struck_s, self._brakes_within_s)
        if not interrupted:
            return None
        if began_s is None:
            return ArmStop(began_s=None, stood_s=None)
        stood_s = await log.until_mode(*AT_REST, after_s=began_s, within_s=self._brakes_within_s)
        return ArmStop(began_s=began_s - struck_s, stood_s=None if stood_s is None else stood_s - struck_s)
