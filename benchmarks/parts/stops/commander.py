"""A commander that makes the arm run one program under its lease, for ever, in a process that may be killed."""

import asyncio
import logging
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, TypeVar

import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.skill import Skill
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.decision.api import STOP_TASK
from dlokit.description.arm.franka import FRANKA_HAND, PANDA
from dlokit.description.shapes import CENTRE_M
from dlokit.errors import ProcessFailure
from dlokit.skills.robot import api as robot
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.live import leases_held
from dlokit.system.live_system import LiveSystem
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.workers import end_with_parent
from dlokit.system.table import TimeBase
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState
from parts.logs import ArmLog
from parts.stops.attempts import Attempt, AttemptLog

P = ParamSpec("P")
R = TypeVar("R")

SWING_RAD = 2.4
"""Of the first joint, to either side of home, always to the farther one: a motion takes 1.4 s at least, long enough to
be interrupted at any moment of its first second."""
NUDGE_RAD = 0.1
RETRY_S = 0.05
PAUSE_S = 1.0
"""Time without a motion in the program with pauses [s]."""
OPENING_M = 0.05
ABOVE_M = 0.12
"""Height of the tool centre point before the grasp and while the DLO is carried [m]."""
CARRY_M = 0.1
"""The DLO is carried so far across itself, towards the arm and away from it, always to the farther end [m]."""


class CommandedArm:
    """The arm, as a program sees it."""

    def __init__(self, transport: Transport, reports: Connection) -> None:
        """An `Attempt` is sent to `reports` when a call begins and when it ends."""
        self._transport = transport
        self._reports = reports

    @property
    def state(self) -> RobotState | None:
        """The newest state; None before the first."""
        return self._transport.latest(topics.ROBOT_STATE).value

    async def do(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> bool:
        """Call a skill; whether it succeeded. After another outcome the arm is recovered.

        Where a person has stopped the arm, each way to move it is tried.
        """
        outcome = await self._call(skill, *args, **kwargs)
        if isinstance(outcome, Succeeded):
            return True
        await asyncio.sleep(RETRY_S)
        await self._call(robot.RECOVER)
        if isinstance(outcome, Rejected) and outcome.reason == robot.ENABLED.reason:
            await self._call(robot.GRASP)
            # A little nearer to home: what is held is not shaken.
            q_rad = PANDA.home_q_rad if self.state is None else self.state.q_rad
            await self._call(robot.MOVE_JOINTS, q_rad + towards_home(self.state, NUDGE_RAD))
        return False

    async def swing(self) -> None:
        """Move the first joint to the other side of home than it is now."""
        await self.do(robot.MOVE_JOINTS, PANDA.home_q_rad + towards_home(self.state, SWING_RAD))

    async def _call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        attempt = Attempt(skill=skill.key, began_s=time.monotonic())
        self._reports.send(attempt)
        outcome = await self._transport.call(skill, *args, **kwargs)
        self._reports.send(replace(attempt, ended_s=time.monotonic(), ended_as=outcome_name(outcome)))
        return outcome


def outcome_name(outcome: Outcome[Any]) -> str:
    """The kind of an outcome, and its reason where it has one."""
    match outcome:
        case Failed(reason=reason) | Rejected(reason=reason):
            return f"{type(outcome).__name__} {reason}"
        case _:
            return type(outcome).__name__


def towards_home(state: RobotState | None, angle_rad: float) -> Float64Array:
    """A turn (7,) of the first joint [rad] by so much, from where it is towards home."""
    side = 1.0 if state is None or state.q_rad[0] < PANDA.home_q_rad[0] else -1.0
    return np.array([side * angle_rad, 0, 0, 0, 0, 0, 0])


async def to_and_fro(arm: CommandedArm) -> None:
    """Swing the first joint."""
    await arm.swing()


async def with_pauses(arm: CommandedArm) -> None:
    """Swing the first joint, and do nothing for a while."""
    await arm.swing()
    await asyncio.sleep(PAUSE_S)


async def grips(arm: CommandedArm) -> None:
    """Open and close the fingers on nothing."""
    await arm.do(robot.RELEASE, FRANKA_HAND.open_width_m)
    await arm.do(robot.GRASP)


async def carries(arm: CommandedArm) -> None:
    """Grasp the DLO, a straight one along y, in its middle; carry it across itself and never let it go."""
    state = arm.state
    if state is None:
        await asyncio.sleep(RETRY_S)
    elif state.holding:
        side = 1.0 if state.T_world_tcp.position_m[0] < CENTRE_M[0] else -1.0
        await arm.do(robot.MOVE_LINEAR, _tool(side * CARRY_M, ABOVE_M), VelocityProfile())
    else:
        above, around = _tool(0.0, ABOVE_M), _tool(0.0, FRANKA_HAND.grasp_height_m())
        picked = (
            await arm.do(robot.RELEASE, OPENING_M)
            and await arm.do(robot.MOVE_TO, above)
            and await arm.do(robot.MOVE_LINEAR, around, VelocityProfile())
            and await arm.do(robot.GRASP)
        )
        if picked:
            await arm.do(robot.MOVE_LINEAR, above, VelocityProfile())


def _tool(aside_m: float, height_m: float) -> Pose:
    """The tool across a DLO along y, so far beside its middle."""
    return geometry.downward((CENTRE_M[0] + aside_m, CENTRE_M[1], height_m), np.pi / 2.0)


Program = Callable[[CommandedArm], Awaitable[None]]
"""What a commander does again and again."""
TAKEN_OVER_S = 60.0
"""The lease of a commander that was killed runs out long before."""


class DeafTask(Component):
    """A task that says that it ends, and goes on: what keeps the arm still must be the arm."""

    name = "decision"

    @implements(STOP_TASK)
    async def stop_task(self, by: str = "") -> bool:
        """Say that it ends."""
        return True


def _main(bus: ZenohConfig, program: Program, reports: Connection) -> None:
    end_with_parent()
    logging.basicConfig(level=logging.WARNING)
    # A guest that serves skills: other guests, such as `dlokit stop`, meet it at a socket of its own.
    assert bus.login is not None, "a bus on one machine asks for its key"
    folder = bus.connect[0].rpartition("/")[0]
    reachable = replace(bus, listen=(f"{folder}/commander-{os.getpid()}",), accepts=(bus.login,))
    asyncio.run(_command(reachable, program, reports))


async def _command(reachable: ZenohConfig, program: Program, reports: Connection) -> None:
    async with join_bus(reachable, TimeBase.CELL) as bus:
        await bus.first_tick()
        host = Container(bus.transport, bus.clock)
        host.add(DeafTask())
        arm = CommandedArm(bus.transport, reports)
        async with host, asyncio.timeout(None) as limit:
            limit.reschedule(asyncio.get_running_loop().time() + TAKEN_OVER_S)
            while True:
                try:
                    async with leases_held(bus.transport, bus.clock, RobotConfig()):
                        limit.reschedule(None)
                        while True:
                            await program(arm)
                except ProcessFailure:
                    await asyncio.sleep(RETRY_S)


class Commanded:
    """A live system and the commander of its first arm, which may be frozen, killed and replaced."""

    def __init__(self, live: LiveSystem) -> None:
        """Made on a running event loop; nothing is commanded yet."""
        self.live = live
        self.log = ArmLog(live.transport)
        self.attempts = AttemptLog()
        self._program: Program = to_and_fro
        self._process: BaseProcess | None = None

    def begin(self, program: Program) -> None:
        """Start a commander with a program."""
        self._program = program
        self.replace()

    def replace(self) -> None:
        """Start another one with the same program. What it needs is imported once for all of them, so it is fast."""
        context: Any = multiprocessing.get_context("forkserver")
        # A process of the fork server runs the main module again, which imports what this one has imported.
        context.set_forkserver_preload([name for name in sys.modules if name.startswith("dlokit.")])
        reports, sender = multiprocessing.Pipe(duplex=False)
        self.attempts.listen(reports)
        of_commander = (self.live.bus, self._program, sender)
        process: BaseProcess = context.Process(target=_main, args=of_commander, daemon=True, name="commander")
        process.start()
        self._process = process
        sender.close()  # the commander has its own

    def kill(self) -> None:
        """Kill it, frozen or not; without a commander, do nothing."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._process = None
        self.attempts.close()

    def freeze(self) -> None:
        """Stop the process of the commander."""
        self._signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let a frozen commander go on."""
        self._signal(signal.SIGCONT)

    def _signal(self, number: signal.Signals) -> None:
        assert self._process is not None, "a commander was started"
        assert self._process.pid is not None, "a commander was started"
        os.kill(self._process.pid, number)
