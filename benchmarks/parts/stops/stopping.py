"""How soon the arm brakes when its commander or its feedback is lost, and how often when nothing is wrong."""

import os
import signal
import tempfile
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dlokit.errors import ProcessFailure
from dlokit.system.config import RunConfig
from dlokit.system.live import LiveSystem
from dlokit.system.table import SECOND
from dlokit.types.robot import RobotMode
from parts.faults.disturbance import FILE_NAME as DISTURBANCE
from parts.faults.disturbance import Disturbance, disturb, disturbed_process
from parts.small_system import arm_and_cell, burden
from parts.stops.commander import Order, end_commander, pid_of, start_commander
from parts.stops.logs import AT_REST, ArmLog

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


@dataclass(frozen=True, kw_only=True)
class StopFigures:
    """All that is measured."""

    killed: tuple[ArmStop, ...] = ()
    """The commander of the arm."""
    frozen: tuple[ArmStop, ...] = ()
    withheld: tuple[ArmStop, ...] = ()
    """Feedback of the arm, from its driver."""
    silenced: tuple[ArmStop, ...] = ()
    """The process of another arm in the same cell: it was frozen."""
    watched_s: float = 0.0
    """Time in which nothing was done to a commander in motion [s]."""
    false_stops: int = 0
    """How often the arm braked in that time."""

    @property
    def by_fault(self) -> dict[str, tuple[ArmStop, ...]]:
        """The stops after each fault that was tried, by its name."""
        each = {
            "commander killed": self.killed,
            "commander frozen": self.frozen,
            "feedback withheld": self.withheld,
            "other arm silent": self.silenced,
        }
        return {name: stops for name, stops in each.items() if stops}


@dataclass(frozen=True, kw_only=True)
class StopPlan:
    """What to measure."""

    run: RunConfig
    kills: int
    freezes: int
    feedback_losses: int
    """How often feedback is withheld from the arm's driver, and as often another arm falls silent."""
    quiet_s: float
    busy_processes: int
    seed: int
    brakes_within_s: float = BRAKES_WITHIN_S
    """Longest time from a fault to the brake, and from the brake to rest; an arm that takes longer never stops [s]."""


async def measure_stops(plan: StopPlan, said: Callable[[str], None]) -> StopFigures:
    """Run the plan on cell, robots and commander as processes of this machine; `said` hears how far it is."""
    figures = StopFigures()
    if plan.kills or plan.freezes or plan.quiet_s:
        async with _trials(plan, 1, said) as trials:
            figures = await trials.of_commander()
    if plan.feedback_losses:
        async with _trials(plan, 1, said) as trials:
            figures = replace(figures, withheld=await trials.feedback_withheld())
        async with _trials(plan, 2, said) as trials:
            figures = replace(figures, silenced=await trials.other_arm_silent())
    return figures


@asynccontextmanager
async def _trials(plan: StopPlan, arms: int, said: Callable[[str], None]) -> AsyncGenerator["FaultTrials"]:
    """A system with so many arms, of which the first is commanded, on a machine that is busy as planned."""
    with tempfile.TemporaryDirectory(prefix="dlokit-stop-") as name:
        folder = Path(name)
        process = disturbed_process(folder / DISTURBANCE)
        run_dir = folder / "run"
        run_dir.mkdir()
        async with arm_and_cell(replace(plan.run, arms=arms), run_dir, process) as live:
            trials = FaultTrials(plan, live, folder, said)
            try:
                await trials.begin()
                with burden(plan.busy_processes):  # from here on: starting takes long enough without
                    yield trials
            finally:
                trials.end()


class FaultTrials:
    """Faults of one system, whose processes read from a file in `folder` how their bus is disturbed."""

    def __init__(self, plan: StopPlan, live: LiveSystem, folder: Path, said: Callable[[str], None]) -> None:
        """Start the commander of the first arm."""
        self._plan = plan
        self._live = live
        self._folder = folder
        self._arm = ArmLog(live.transport)
        self._order = Order(bus=live.bus, robot=plan.run.robot)
        self._said = said
        self._rng = np.random.default_rng(plan.seed)
        self._commander = start_commander(self._order)

    async def begin(self) -> None:
        """Return when the commander moves the arm."""
        await self._moving(after_s=0.0, within_s=STARTS_WITHIN_S)

    def end(self) -> None:
        """End the commander."""
        end_commander(self._commander)

    async def of_commander(self) -> StopFigures:
        """What becomes of the arm when nothing is done to its commander, when it is frozen, and when it is killed."""
        false_stops, watched_s = await self._watch()
        frozen = await self._repeated("frozen", self._plan.freezes, self._freeze, self._thaw)
        killed = await self._repeated("killed", self._plan.kills, self._kill, self._restart_commander)
        return StopFigures(killed=killed, frozen=frozen, watched_s=watched_s, false_stops=false_stops)

    async def feedback_withheld(self) -> tuple[ArmStop, ...]:
        """What the arm feels does not come to its driver any more."""

        def withhold() -> None:
            disturb(self._folder, Disturbance.NO_FEEDBACK)

        def hand_on() -> None:
            disturb(self._folder, Disturbance.NONE)

        return await self._repeated("feedback withheld", self._plan.feedback_losses, withhold, hand_on)

    async def other_arm_silent(self) -> tuple[ArmStop, ...]:
        """The process of the second arm is frozen."""
        other = self._live.supervisor.pids[SECOND.name]

        def freeze() -> None:
            os.kill(other, signal.SIGSTOP)

        def thaw() -> None:
            os.kill(other, signal.SIGCONT)

        return await self._repeated("other arm silent", self._plan.feedback_losses, freeze, thaw)

    async def _repeated(
        self, name: str, times: int, fault: Callable[[], None], mend: Callable[[], None]
    ) -> tuple[ArmStop, ...]:
        stops: list[ArmStop] = []
        while len(stops) < times:
            stop = await self._faulted(fault)
            mend()
            if stop is not None:
                stops.append(stop)
                self._said(f"{name}, {len(stops)} of {times}")
        return tuple(stops)

    async def _watch(self) -> tuple[int, float]:
        """Let the arm move for a while; how often it braked."""
        before, began_s = self._arm.brakings, time.monotonic()
        end_s = began_s + self._plan.quiet_s
        while time.monotonic() < end_s:
            await self._moving(after_s=time.monotonic())
            left_s = max(end_s - time.monotonic(), 0.0)
            self._said(f"{left_s:.0f} s of quiet motion left; braked {self._arm.brakings - before} times")
        return self._arm.brakings - before, time.monotonic() - began_s

    def _freeze(self) -> None:
        os.kill(pid_of(self._commander), signal.SIGSTOP)

    def _thaw(self) -> None:
        os.kill(pid_of(self._commander), signal.SIGCONT)

    def _kill(self) -> None:
        os.kill(pid_of(self._commander), signal.SIGKILL)

    def _restart_commander(self) -> None:
        self._commander.join()
        self._commander = start_commander(self._order)

    async def _faulted(self, fault: Callable[[], None]) -> ArmStop | None:
        """At a random moment of a motion; None when the motion came to its end before anybody had to notice."""
        while True:
            await self._moving(after_s=time.monotonic())
            await self._live.clock.sleep(float(self._rng.uniform(0.0, LATEST_S)))
            if self._arm.mode is RobotMode.MOVING:  # and was not braked meanwhile
                break
        struck_s = time.monotonic()
        fault()
        ended = (RobotMode.BRAKING, *AT_REST)
        ended_s = await self._arm.until_mode(*ended, after_s=struck_s, within_s=self._plan.brakes_within_s)
        if ended_s is None:
            return ArmStop(began_s=None, stood_s=None)
        if self._arm.mode_at(ended_s) is not RobotMode.BRAKING:
            return None
        stood_s = await self._arm.until_mode(*AT_REST, after_s=ended_s, within_s=self._plan.brakes_within_s)
        return ArmStop(began_s=ended_s - struck_s, stood_s=None if stood_s is None else stood_s - struck_s)

    async def _moving(self, *, after_s: float, within_s: float = MOVES_WITHIN_S) -> None:
        """Return when the arm has begun its next motion. Raises `ProcessFailure` when it does not."""
        if await self._arm.until_mode(RobotMode.MOVING, after_s=after_s, within_s=within_s) is None:
            raise ProcessFailure("no_motion", f"the commander did not move the arm within {within_s:g} s")
