"""Whether a person's stop holds: pressed at random moments, whatever the commander does or has become of it."""

import asyncio
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from dlokit.communication.container import end_tasks
from dlokit.errors import InputError, ProcessFailure
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.live import LiveSystem
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.processes.stop_socket import CONFIRMED_STOP, stop_socket
from dlokit.types.robot import RobotMode, RobotState
from parts.small_system import arm_and_cell, burden
from parts.stops import commander
from parts.stops.logs import ArmLog, AttemptLog
from parts.stops.press_verdict import Press, PressRow, StopReport, Watched, all_tried, judged

ACTS_WITHIN_S = 90.0
"""A commander that has just been started, thawed or enabled moves the arm long before, on a busy machine too."""
TRIED_WITHIN_S = 30.0
"""A commander has tried everything long before: one that was thawed may have to find the bus again."""
WATCHED_S = 1.0
"""A stopped arm is watched for at least so long while its commander tries to move it [s]."""
LATEST_S = 0.9
"""A stop comes within this time of the moment that its row waits for [s]."""
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
CONFIRMED, NOT_ALL = 0, 3
"""Exit codes of `dlokit stop`."""


@dataclass(frozen=True, kw_only=True)
class Person:
    """The two commands of a person, each of which returns its exit code."""

    stop: Callable[[RunningSystem, Callable[[str], None]], Awaitable[int]]
    """`dlokit stop`, with the function that prints its lines."""
    enable: Callable[[RunningSystem], Awaitable[int]]
    """`dlokit enable`."""


@dataclass(frozen=True)
class PressScene:
    """What all rows share."""

    run: RunConfig
    person: Person
    said: Callable[[str], None]
    rng: np.random.Generator

    async def wait_up_to(self, latest_s: float) -> None:
        """Wait for a random time [s]."""
        await asyncio.sleep(float(self.rng.uniform(0.0, latest_s)))

    def tell(self, row: str, number: int, count: int, press: Press) -> None:
        """Say how far a row is, and what was wrong."""
        wrong = f": {'; '.join(press.wrong)}" if press.wrong else ""
        self.said(f"{row}, {number + 1} of {count}{wrong}")

    async def stop(self, folder: Path) -> tuple[StopReport, float]:
        """Press, and the time from which the arm must stand [s of the machine's monotonic clock].

        The time until the confirmation counts from when the robot's process listens.
        """
        system, confirmed_at_s = the_running_system(folder, starting=True), list[float]()
        lines = list[str]()

        def hear(line: str) -> None:
            lines.append(line)
            if CONFIRMED_STOP in line:
                confirmed_at_s.append(time.monotonic())

        listens = asyncio.create_task(_listens(stop_socket(folder, "")), name="listens")
        try:
            exit_code = await self.person.stop(system, hear)
            said = "; ".join(lines)
            if not confirmed_at_s:
                return StopReport(confirmed_s=None, exit_code=exit_code, said=said), time.monotonic()
            confirmed_s = confirmed_at_s[0] - await listens
            return StopReport(confirmed_s=confirmed_s, exit_code=exit_code, said=said), confirmed_at_s[0]
        finally:
            await end_tasks(listens)


class Trials:
    """Stops of one system."""

    def __init__(self, scene: PressScene, live: LiveSystem, folder: Path) -> None:
        self._scene = scene
        self._live = live
        self._folder = folder
        self._states = ArmLog(live.transport)
        self._attempts = AttemptLog()
        self._program = ""
        self._commander: BaseProcess | None = None

    async def row(self, row: "PressMoment", count: int) -> PressRow:
        """Press in each run at the moment of the row."""
        presses: list[Press] = []
        try:
            self._begin(row.program)
            while len(presses) < count:
                press = await self._press(row)
                self._scene.tell(row.name, len(presses), count, press)
                presses.append(press)
        except ProcessFailure as failure:  # the figures of the other rows are kept
            press = Press(confirmed_s=None, moved_rad=0.0, fingers_m=0.0, wrong=(f"the row ended early: {failure}",))
            self._scene.tell(row.name, len(presses), count, press)
            presses.append(press)
        finally:
            self._end()
        return PressRow(name=row.name, presses=tuple(presses))

    async def after_start(self, report: StopReport, from_s: float, row: "PressMoment") -> Press:
        """Judge a stop that came before any commander."""
        try:
            self._begin(row.program)
            return await self.judge(report, from_s, row)
        finally:
            self._end()

    async def judge(self, report: StopReport, from_s: float, row: "PressMoment") -> Press:
        """Let the commander try for a while, enable the arm, and see it move."""
        await asyncio.sleep(WATCHED_S)
        await self._attempts.until(lambda: all_tried(self._attempts.between(from_s, time.monotonic())), TRIED_WITHIN_S)
        end_s = time.monotonic()
        watched = Watched(states=self._states.since(from_s), attempts=self._attempts.between(from_s, end_s))
        goes_on = await self._enable()
        return judged(report, watched, exit_code=row.exit_code, holds=row.holds, goes_on=goes_on)

    async def _press(self, row: "PressMoment") -> Press:
        await row.moment(self)
        report, from_s = await self._scene.stop(self._folder)
        row.then(self)
        return await self.judge(report, from_s, row)

    async def moves(self) -> None:
        """Wait for a random moment of a motion."""
        await self._moment(lambda state: _speed_rad_s(state) > MOVING_RAD_S)

    async def carries(self) -> None:
        """Wait for a random moment of a motion that carries the DLO."""
        await self._moment(lambda state: state.holding and _speed_rad_s(state) > MOVING_RAD_S)

    async def closes(self) -> None:
        """Wait for a random moment at which the fingers close."""
        narrow_m, wide_m = CLOSING_M
        grasps = robot.GRASP.key
        await self._moment(lambda state: self._attempts.running == grasps and narrow_m < state.finger_width_m < wide_m)

    async def pauses(self) -> None:
        """Wait for a random moment between two motions."""
        await self._moment(lambda state: self._attempts.running == "" and state.mode is RobotMode.IDLE)

    async def frozen(self) -> None:
        """Freeze the commander in a motion."""
        await self.moves()
        self._signal(signal.SIGSTOP)
        await self._scene.wait_up_to(STRUCK_S)

    def thaw(self) -> None:
        """Let a frozen commander go on."""
        self._signal(signal.SIGCONT)

    async def killed(self) -> None:
        """Kill the commander in a motion."""
        await self.moves()
        self._end()
        await self._scene.wait_up_to(STRUCK_S)

    def replace(self) -> None:
        """Start another commander with the same program."""
        self._begin(self._program)

    async def recovers(self) -> None:
        """Take the lease from the commander by freezing it; wait for a random moment of its `robot.recover`."""
        latest_s = RECOVERS_S
        for _ in range(RECOVERIES):
            await self.moves()
            self._signal(signal.SIGSTOP)
            await self._until(lambda state: state.mode is not RobotMode.MOVING, "brake")
            self.thaw()
            # A motion that ended before the lease did leaves nothing to recover from.
            if await self._attempts.until(self._is_recovering, RECOVERS_WITHIN_S):
                await self._scene.wait_up_to(latest_s)
                if self._is_recovering():
                    return
                latest_s /= 2.0
        raise ProcessFailure("no_recovery", f"{robot.RECOVER.key} was not met running in {RECOVERIES} attempts")

    def nothing(self) -> None:
        """The commander goes on as it is."""

    def _begin(self, program: str) -> None:
        reports, sender = multiprocessing.Pipe(duplex=False)
        self._attempts.listen(reports)
        self._program = program
        order = commander.Order(bus=self._live.bus, robot=self._scene.run.robot, program=program, reports=sender)
        self._commander = commander.start_commander(order)
        sender.close()  # the commander has its own

    def _end(self) -> None:
        if self._commander is not None:
            commander.end_commander(self._commander)
        self._commander = None
        self._attempts.close()

    def _signal(self, number: signal.Signals) -> None:
        assert self._commander is not None, "a row begins with one"
        os.kill(commander.pid_of(self._commander), number)

    def _is_recovering(self) -> bool:
        return self._attempts.running == robot.RECOVER.key

    async def _moment(self, is_so: Callable[[RobotState], bool]) -> None:
        """Return at a random moment at which it is so."""
        while True:
            await self._until(is_so, f"do what the program {self._program!r} does")
            await self._scene.wait_up_to(LATEST_S)
            newest = self._states.newest
            if newest is not None and is_so(newest):
                return

    async def _until(self, is_so: Callable[[RobotState], bool], what: str) -> None:
        if not await self._states.until(is_so, ACTS_WITHIN_S):
            raise ProcessFailure("no_motion", f"the arm did not {what} within {ACTS_WITHIN_S:g} s")

    async def _enable(self) -> bool:
        """Whether arm or fingers move after it."""
        newest = self._states.newest
        width_m = newest.finger_width_m if newest is not None else 0.0
        if await self._scene.person.enable(the_running_system(self._folder)) != CONFIRMED:
            return False

        def moves(state: RobotState) -> bool:
            return _speed_rad_s(state) > MOVING_RAD_S or abs(state.finger_width_m - width_m) > FINGERS_MOVE_M

        return await self._states.until(moves, ACTS_WITHIN_S)


@dataclass(frozen=True, kw_only=True)
class PressMoment:
    """When to press, and what must hold then."""

    name: str
    program: str = commander.TO_AND_FRO
    moment: Callable[[Trials], Awaitable[None]] = Trials.moves
    then: Callable[[Trials], None] = Trials.nothing
    """What is done to the commander after the stop, so that one tries to move the arm."""
    exit_code: int = CONFIRMED
    """Of `dlokit stop`: 3 where the commander could not say that its task ends."""
    holds: bool = False
    """Whether the fingers hold the DLO, and must go on holding it."""


async def _listens(socket: Path) -> float:
    """When there is a socket, by the machine's monotonic clock [s]; now, where there is one already."""
    await until_there(socket.exists)
    return time.monotonic()


async def until_there(is_there: Callable[[], bool]) -> None:
    """Wait until it is, looking again and again."""
    while True:
        if is_there():
            return
        await asyncio.sleep(LOOK_S)


def _speed_rad_s(state: RobotState) -> float:
    return float(np.abs(state.dq_rad_s).max())


STARTING_S = 1.5
"""A stop comes within this time of the start of a system [s]: its robot's process is not ready yet."""


# fmt: off
STARTING = PressMoment(name="system starts")
ROWS = (
    PressMoment(name="commander frozen", moment=Trials.frozen, then=Trials.thaw, exit_code=NOT_ALL),
    PressMoment(name="commander killed", moment=Trials.killed, then=Trials.replace, exit_code=NOT_ALL),
    PressMoment(name="recover runs", moment=Trials.recovers),
    PressMoment(name="between motions", program=commander.WITH_PAUSES, moment=Trials.pauses),
    PressMoment(name="fingers close", program=commander.GRIPS, moment=Trials.closes),
    PressMoment(name="DLO is carried", program=commander.CARRIES, moment=Trials.carries, holds=True),
)
# fmt: on


@dataclass(frozen=True, kw_only=True)
class PressPlan:
    """What to measure."""

    run: RunConfig
    presses: int
    """Stops of each row."""
    busy_processes: int
    seed: int


async def measure_presses(plan: PressPlan, person: Person, said: Callable[[str], None]) -> tuple[PressRow, ...]:
    """Press and enable as often as planned in each row; `said` hears how far it is.

    Raises `ProcessFailure` when a system does not start, or is ready too soon.
    """
    scene = PressScene(plan.run, person, said, np.random.default_rng(plan.seed))
    rows = [await _row_of_starts(scene, plan.presses)]
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as folder:
        async with arm_and_cell(plan.run, Path(folder)) as live:
            with burden(plan.busy_processes):
                rows += [await Trials(scene, live, Path(folder)).row(row, plan.presses) for row in ROWS]
    return tuple(rows)


async def _row_of_starts(scene: PressScene, count: int) -> PressRow:
    """A new system for each stop."""
    presses: list[Press] = []
    for number in range(count):
        press = await _press_at_start(scene)
        scene.tell(STARTING.name, number, count, press)
        presses.append(press)
    return PressRow(name=STARTING.name, presses=tuple(presses))


async def _press_at_start(scene: PressScene) -> Press:
    with tempfile.TemporaryDirectory(prefix="dlokit-press-") as name:
        folder = Path(name)
        stopping = asyncio.create_task(stop_at_start(scene, folder), name="stop at the start")
        try:
            async with arm_and_cell(scene.run, folder) as live:
                trials = Trials(scene, live, folder)
                return await trials.after_start(*await stopping, STARTING)
        finally:
            await end_tasks(stopping)


async def stop_at_start(scene: PressScene, folder: Path) -> tuple[StopReport, float]:
    """Press at a random moment of the start of a system.

    Raises `ProcessFailure` when it is ready before.
    """
    await until_there(lambda: _announced(folder) is not None)
    await scene.wait_up_to(STARTING_S)
    system = _announced(folder)
    if system is None or not system.starting:
        raise ProcessFailure("not_starting", f"the system was ready, or gone, within {STARTING_S:g} s of its start")
    return await scene.stop(folder)


def _announced(folder: Path) -> RunningSystem | None:
    try:
        return the_running_system(folder, starting=True)
    except InputError:
        return None
