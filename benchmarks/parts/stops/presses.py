"""Whether a person's stop holds: pressed at random moments, whatever the commander does or has become of it."""

import asyncio
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.app.operate import enable, stop
from dlokit.communication.container import end_tasks
from dlokit.errors import EXIT_OTHERWISE, InputError, ProcessFailure
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.processes.stop_socket import CONFIRMED_STOP, stop_socket
from dlokit.types.robot import RobotMode, RobotState
from parts.arm_and_cell import arm_and_cell, burden
from parts.stops.commander import Commanded, Program, carries, grips, to_and_fro, with_pauses
from parts.stops.press_verdict import Press, StopReport, judged, not_tried

ACTS_WITHIN_S = 90.0
"""A commander that has just been started, thawed or enabled moves the arm long before, on a busy machine too."""
TRIED_WITHIN_S = 30.0
"""A commander has tried everything long before: one that was thawed may have to find the bus again."""
WATCHED_S = 1.0
"""A stopped arm is watched for at least so long while its commander tries to move it [s]."""
LATEST_S = 0.9
"""A stop comes within this time of the moment that its row waits for [s]."""
STARTING_S = 1.5
"""A stop comes within this time of the start of a system [s]: its robot's process is not ready yet."""
STRUCK_S = 0.5
"""A stop comes within this time of the signal that kills or freezes the commander [s]: before its lease has run out,
while the arm brakes, or when it stands."""
RECOVERS_S = 0.02
"""A stop comes within this time of the call of `robot.recover` [s]; half of it after a call that ended sooner."""
RECOVERS_WITHIN_S = 3.0
RECOVERIES = 50
"""A commander is frozen at most so many times until a stop meets its `robot.recover`."""
LOOK_S = 0.005
MOVING_RAD_S = 0.2
FINGERS_MOVE_M = 0.005
CLOSING_M = (0.005, 0.075)
"""Fingers of a width between these two close [m]; outside they may have come to rest."""

StopCommand = Callable[[RunningSystem, Callable[[str], None]], Awaitable[int]]
"""`dlokit stop`: it prints its lines with the function, and returns its exit code."""


async def stop_command(system: RunningSystem, say: Callable[[str], None]) -> int:
    """As a person types it."""
    return stop.exit_code(await stop.stop_all([system], say=say))


async def press(folder: Path, command: StopCommand) -> StopReport:
    """Press. The time until the confirmation counts from when the robot's process listens."""
    system, confirmed_at_s = the_running_system(folder, starting=True), list[float]()
    lines = list[str]()

    def hear(line: str) -> None:
        lines.append(line)
        if CONFIRMED_STOP in line:
            confirmed_at_s.append(time.monotonic())

    async def listens() -> float:
        await until_there(stop_socket(folder, "").exists)
        return time.monotonic()

    listening = asyncio.create_task(listens(), name="listens")
    try:
        exit_code = await command(system, hear)
        from_s = confirmed_at_s[0] if confirmed_at_s else time.monotonic()
        confirmed_s = from_s - await listening if confirmed_at_s else None
        return StopReport(confirmed_s=confirmed_s, exit_code=exit_code, from_s=from_s, said="; ".join(lines))
    finally:
        await end_tasks(listening)


async def press_at_start(folder: Path, command: StopCommand, rng: np.random.Generator) -> StopReport:
    """Press at a random moment of the start of a system. Raises `ProcessFailure` when it is ready before."""

    def announced() -> RunningSystem | None:
        try:
            return the_running_system(folder, starting=True)
        except InputError:
            return None

    await until_there(lambda: announced() is not None)
    await asyncio.sleep(float(rng.uniform(0.0, STARTING_S)))
    system = announced()
    if system is None or not system.starting:
        raise ProcessFailure("not_starting", f"the system was ready, or gone, within {STARTING_S:g} s of its start")
    return await press(folder, command)


async def until_there(is_there: Callable[[], bool]) -> None:
    """Wait until it is, looking again and again."""
    while not is_there():  # noqa: ASYNC110  a file wakes nobody
        await asyncio.sleep(LOOK_S)


class PressTrials:
    """Stops of one system, whose run folder is `folder`."""

    def __init__(
        self, commanded: Commanded, folder: Path, rng: np.random.Generator, command: StopCommand = stop_command
    ) -> None:
        self.commanded = commanded
        self._folder = folder
        self._rng = rng
        self._command = command

    async def row(self, row: "PressMoment", count: int, said: Callable[[str], None]) -> list[Press]:
        """Press so many times at the moment of the row."""
        presses: list[Press] = []
        try:
            self.commanded.begin(row.program)
            while len(presses) < count:
                await row.moment(self)
                report = await press(self._folder, self._command)
                row.then(self.commanded)
                presses.append(await self._judge(report, row))
                tell(said, row.name, presses, count)
        except ProcessFailure as failure:  # the figures of the other rows are kept
            presses.append(Press(confirmed_s=None, wrong=(f"the row ended early: {failure}",)))
            tell(said, row.name, presses, count)
        finally:
            self.commanded.kill()
        return presses

    async def after_start(self, report: StopReport) -> Press:
        """Judge a stop that came before any commander."""
        try:
            self.commanded.begin(STARTING.program)
            return await self._judge(report, STARTING)
        finally:
            self.commanded.kill()

    async def _judge(self, report: StopReport, row: "PressMoment") -> Press:
        """Let the commander try for a while, enable the arm, and see it move."""
        attempts, from_s = self.commanded.attempts, report.from_s
        await asyncio.sleep(WATCHED_S)
        await attempts.until(lambda: not not_tried(attempts.between(from_s, time.monotonic())), TRIED_WITHIN_S)
        states, tried = self.commanded.log.since(from_s), attempts.between(from_s, time.monotonic())
        goes_on = await self._enable()
        return judged(report, states, tried, exit_code=row.exit_code, holds=row.holds, goes_on=goes_on)

    async def _enable(self) -> bool:
        """Whether arm or fingers move after `dlokit enable`."""
        newest = self.commanded.log.newest
        width_m = newest.finger_width_m if newest is not None else 0.0
        system = the_running_system(self._folder)
        answers = await enable.enable_all(system, stop.arms_of(self._folder).values())
        if enable.exit_code(answers) != 0:
            return False
        return await self.commanded.log.until_state(
            lambda state: moves(state) or abs(state.finger_width_m - width_m) > FINGERS_MOVE_M, ACTS_WITHIN_S
        )

    async def moves(self) -> None:
        """Wait for a random moment of a motion."""
        await self._moment(moves)

    async def carries(self) -> None:
        """Wait for a random moment of a motion that carries the DLO."""
        await self._moment(lambda state: state.holding and moves(state))

    async def closes(self) -> None:
        """Wait for a random moment at which the fingers close."""
        narrow_m, wide_m = CLOSING_M
        await self._moment(lambda state: self._runs(robot.GRASP.key) and narrow_m < state.finger_width_m < wide_m)

    async def pauses(self) -> None:
        """Wait for a random moment between two motions."""
        await self._moment(lambda state: self._runs("") and state.mode is RobotMode.IDLE)

    async def frozen(self) -> None:
        """Freeze the commander in a motion."""
        await self.moves()
        self.commanded.freeze()
        await self._wait_up_to(STRUCK_S)

    async def killed(self) -> None:
        """Kill the commander in a motion."""
        await self.moves()
        self.commanded.kill()
        await self._wait_up_to(STRUCK_S)

    async def recovers(self) -> None:
        """Take the lease from the commander by freezing it; wait for a random moment of its `robot.recover`."""
        latest_s, recovers = RECOVERS_S, robot.RECOVER.key
        for _ in range(RECOVERIES):
            await self.moves()
            self.commanded.freeze()
            await self._until(lambda state: state.mode is not RobotMode.MOVING, "brake")
            self.commanded.thaw()
            # A motion that ended before the lease did leaves nothing to recover from.
            if await self.commanded.attempts.until(lambda: self._runs(recovers), RECOVERS_WITHIN_S):
                await self._wait_up_to(latest_s)
                if self._runs(recovers):
                    return
                latest_s /= 2.0
        raise ProcessFailure("no_recovery", f"{recovers} was not met running in {RECOVERIES} attempts")

    def _runs(self, skill: str) -> bool:
        return self.commanded.attempts.running == skill

    async def _moment(self, is_so: Callable[[RobotState], bool]) -> None:
        """Return at a random moment at which it is so."""
        while True:
            await self._until(is_so, "do what its program does")
            await self._wait_up_to(LATEST_S)
            newest = self.commanded.log.newest
            if newest is not None and is_so(newest):
                return

    async def _until(self, is_so: Callable[[RobotState], bool], what: str) -> None:
        if not await self.commanded.log.until_state(is_so, ACTS_WITHIN_S):
            raise ProcessFailure("no_motion", f"the arm did not {what} within {ACTS_WITHIN_S:g} s")

    async def _wait_up_to(self, latest_s: float) -> None:
        await asyncio.sleep(float(self._rng.uniform(0.0, latest_s)))


def moves(state: RobotState) -> bool:
    """Whether a joint moves."""
    return float(np.abs(state.dq_rad_s).max()) > MOVING_RAD_S


def tell(said: Callable[[str], None], row: str, presses: list[Press], count: int) -> None:
    """Say how far a row is, and what was wrong with the last stop."""
    wrong = f": {'; '.join(presses[-1].wrong)}" if presses[-1].wrong else ""
    said(f"{row}, {len(presses)} of {count}{wrong}")


def _nothing(commanded: Commanded) -> None:
    pass


@dataclass(frozen=True, kw_only=True)
class PressMoment:
    """When to press, and what must hold then."""

    name: str
    program: Program = to_and_fro
    moment: Callable[[PressTrials], Awaitable[None]] = PressTrials.moves
    then: Callable[[Commanded], None] = _nothing
    """What is done to the commander after the stop, so that one tries to move the arm."""
    exit_code: int = 0
    """Of `dlokit stop`: 3 where the commander could not say that its task ends."""
    holds: bool = False
    """Whether the fingers hold the DLO, and must go on holding it."""


# fmt: off
STARTING = PressMoment(name="system starts")
ROWS = (
    PressMoment(name="commander frozen", moment=PressTrials.frozen, then=Commanded.thaw, exit_code=EXIT_OTHERWISE),
    PressMoment(name="commander killed", moment=PressTrials.killed, then=Commanded.replace, exit_code=EXIT_OTHERWISE),
    PressMoment(name="recover runs", moment=PressTrials.recovers),
    PressMoment(name="between motions", program=with_pauses, moment=PressTrials.pauses),
    PressMoment(name="fingers close", program=grips, moment=PressTrials.closes),
    PressMoment(name="DLO is carried", program=carries, moment=PressTrials.carries, holds=True),
)
# fmt: on


async def measure_presses(count: int, busy: int, seed: int, said: Callable[[str], None]) -> dict[str, list[Press]]:
    """Press and enable so many times in each row, by its name; `said` hears how far it is.

    Raises `ProcessFailure` when a system does not start, or is ready too soon.
    """
    run, rng = RunConfig(runtime="live", headless=True, seed=seed), np.random.default_rng(seed)
    starts: list[Press] = []
    for _ in range(count):
        starts.append(await _press_of_a_start(run, rng))
        tell(said, STARTING.name, starts, count)
    found = {STARTING.name: starts}
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as name:
        async with arm_and_cell(Path(name), run) as live:
            trials = PressTrials(Commanded(live), Path(name), rng)
            with burden(busy):
                for row in ROWS:
                    found[row.name] = await trials.row(row, count, said)
    return found


async def _press_of_a_start(run: RunConfig, rng: np.random.Generator) -> Press:
    """A new system for each stop."""
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as name:
        folder = Path(name)
        stopping = asyncio.create_task(press_at_start(folder, stop_command, rng), name="stop at the start")
        try:
            async with arm_and_cell(folder, run) as live:
                return await PressTrials(Commanded(live), folder, rng).after_start(await stopping)
        finally:
            await end_tasks(stopping)
