"""How soon the arm brakes when its commander is killed or frozen, and how often it does when nothing is wrong."""

import os
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.bench.faults.arm_log import AT_REST, ArmLog
from dlokit.bench.faults.burden import burden
from dlokit.bench.faults.commander import Order, end_commander, pid_of, start_commander
from dlokit.bench.faults.small_system import arm_and_cell
from dlokit.errors import ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.live_system import LiveSystem
from dlokit.types.robot import RobotMode

MOVES_WITHIN_S = 60.0
"""A commander that was thawed, or takes over, moves the arm long before."""
STARTS_WITHIN_S = 180.0
"""The first commander, whose process imports everything."""
BRAKES_WITHIN_S = 5.0
"""An arm that has not braked by then counts as one that never does."""
LATEST_S = 0.9
"""Faults come within this time of the beginning of a motion [s of the arm's clock], which takes 1.4 s at least."""


@dataclass(frozen=True, kw_only=True)
class Stop:
    """What became of the arm after one fault."""

    began_s: float | None
    """From the fault until the arm is heard to brake [s]; None: it never was."""
    stood_s: float | None
    """From the fault until it stands [s]."""


@dataclass(frozen=True, kw_only=True)
class StopFigures:
    """All that is measured."""

    killed: tuple[Stop, ...]
    frozen: tuple[Stop, ...]
    watched_s: float
    """Time in which nothing was done to a commander in motion [s]."""
    false_stops: int
    """How often the arm braked in that time."""


@dataclass(frozen=True, kw_only=True)
class StopPlan:
    """What to measure."""

    run: RunConfig
    kills: int
    freezes: int
    quiet_s: float
    busy_processes: int
    seed: int


async def measure_stops(plan: StopPlan, said: Callable[[str], None]) -> StopFigures:
    """Run the plan on cell, robot and commander as processes of this machine; `said` hears how far it is."""
    with tempfile.TemporaryDirectory(prefix="dlokit-stop-") as folder:
        async with arm_and_cell(plan.run, Path(folder)) as live:
            return await _Trials(plan, live, said).run()


class _Trials:
    def __init__(self, plan: StopPlan, live: LiveSystem, said: Callable[[str], None]) -> None:
        self._plan = plan
        self._clock = live.clock
        self._arm = ArmLog(live.transport)
        self._order = Order(bus=live.bus, robot=plan.run.robot)
        self._said = said
        self._rng = np.random.default_rng(plan.seed)

    async def run(self) -> StopFigures:
        self._commander = start_commander(self._order)
        try:
            await self._moving(after_s=0.0, within_s=STARTS_WITHIN_S)
            with burden(self._plan.busy_processes):  # from here on: starting takes long enough without
                return await self._all()
        finally:
            end_commander(self._commander)

    async def _all(self) -> StopFigures:
        false_stops, watched_s = await self._watch()
        frozen: list[Stop] = []
        for number in range(self._plan.freezes):
            frozen.append(await self._freeze())
            self._said(f"frozen {number + 1} of {self._plan.freezes}")
        killed: list[Stop] = []
        for number in range(self._plan.kills):
            killed.append(await self._kill())
            self._said(f"killed {number + 1} of {self._plan.kills}")
        return StopFigures(killed=tuple(killed), frozen=tuple(frozen), watched_s=watched_s, false_stops=false_stops)

    async def _watch(self) -> tuple[int, float]:
        """Let the arm move for a while; how often it braked."""
        before, began_s = self._arm.brakings, time.monotonic()
        end_s = began_s + self._plan.quiet_s
        while time.monotonic() < end_s:
            await self._moving(after_s=time.monotonic())
            left_s = max(end_s - time.monotonic(), 0.0)
            self._said(f"{left_s:.0f} s of quiet motion left; braked {self._arm.brakings - before} times")
        return self._arm.brakings - before, time.monotonic() - began_s

    async def _freeze(self) -> Stop:
        while True:
            stop = await self._struck(signal.SIGSTOP)
            os.kill(pid_of(self._commander), signal.SIGCONT)
            if stop is not None:
                return stop

    async def _kill(self) -> Stop:
        while True:
            stop = await self._struck(signal.SIGKILL)
            self._commander.join()
            self._commander = start_commander(self._order)
            if stop is not None:
                return stop

    async def _struck(self, fault: signal.Signals) -> Stop | None:
        """At a random moment of a motion; None when the motion came to its end before anybody had to notice."""
        while True:
            await self._moving(after_s=time.monotonic())
            await self._clock.sleep(float(self._rng.uniform(0.0, LATEST_S)))
            if self._arm.mode is RobotMode.MOVING:  # and was not braked meanwhile
                break
        struck_s = time.monotonic()
        os.kill(pid_of(self._commander), fault)
        ended = (RobotMode.BRAKING, *AT_REST)
        ended_s = await self._arm.until(*ended, after_s=struck_s, within_s=BRAKES_WITHIN_S)
        if ended_s is None:
            return Stop(began_s=None, stood_s=None)
        if self._arm.mode_at(ended_s) is not RobotMode.BRAKING:
            return None
        stood_s = await self._arm.until(*AT_REST, after_s=ended_s, within_s=BRAKES_WITHIN_S)
        return Stop(began_s=ended_s - struck_s, stood_s=None if stood_s is None else stood_s - struck_s)

    async def _moving(self, *, after_s: float, within_s: float = MOVES_WITHIN_S) -> None:
        """Return when the arm has begun its next motion. Raises `ProcessFailure` when it does not."""
        if await self._arm.until(RobotMode.MOVING, after_s=after_s, within_s=within_s) is None:
            raise ProcessFailure("no_motion", f"the commander did not move the arm within {within_s:g} s")
