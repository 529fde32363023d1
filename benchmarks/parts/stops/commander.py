"""A commander that makes the arm run one program under its lease, for ever, in a process that may be killed."""

import asyncio
import logging
import multiprocessing
import os
import sys
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
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
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.lease_keeper import leases_held
from dlokit.system.processes.workers import end_with_parent
from dlokit.system.table import TimeBase
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Outcome, Rejected, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState
from parts.stops.logs import Attempt, outcome_name

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

    def __init__(self, transport: Transport, report: Callable[[Attempt], None]) -> None:
        """`report` hears of every call when it begins and when it ends."""
        self._transport = transport
        self._report = report

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
            await self._call(robot.MOVE_JOINTS, nearby(self.state))
        return False

    async def _call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        began_s = time.monotonic()
        self._report(Attempt(skill=skill.key, began_s=began_s))
        outcome = await self._transport.call(skill, *args, **kwargs)
        ended = Attempt(skill=skill.key, began_s=began_s, ended_s=time.monotonic(), ended_as=outcome_name(outcome))
        self._report(ended)
        return outcome


def farther_side(state: RobotState | None) -> Float64Array:
    """Joint angles (7,) [rad] with the first joint on the other side of home than it is now."""
    side = 1.0 if state is None or state.q_rad[0] < PANDA.home_q_rad[0] else -1.0
    return PANDA.home_q_rad + np.array([side * SWING_RAD, 0, 0, 0, 0, 0, 0])


def nearby(state: RobotState | None) -> Float64Array:
    """Joint angles (7,) [rad] with the first joint a little nearer to home: what is held is not shaken."""
    if state is None:
        return PANDA.home_q_rad
    side = 1.0 if state.q_rad[0] < PANDA.home_q_rad[0] else -1.0
    return state.q_rad + np.array([side * NUDGE_RAD, 0, 0, 0, 0, 0, 0])


async def to_and_fro(arm: CommandedArm) -> None:
    """Swing the first joint, without a pause."""
    while True:
        await arm.do(robot.MOVE_JOINTS, farther_side(arm.state))


async def with_pauses(arm: CommandedArm) -> None:
    """Swing the first joint, and do nothing for a while after each motion."""
    while True:
        await arm.do(robot.MOVE_JOINTS, farther_side(arm.state))
        await asyncio.sleep(PAUSE_S)


async def grips(arm: CommandedArm) -> None:
    """Open and close the fingers on nothing."""
    while True:
        await arm.do(robot.RELEASE, FRANKA_HAND.open_width_m)
        await arm.do(robot.GRASP)


async def carries(arm: CommandedArm) -> None:
    """Grasp the DLO, a straight one along y, in its middle; carry it across itself and never let it go."""
    while True:
        state = arm.state
        if state is None:
            await asyncio.sleep(RETRY_S)
            continue
        if not state.holding:
            await _pick(arm)
            continue
        side = 1.0 if state.T_world_tcp.position_m[0] < CENTRE_M[0] else -1.0
        await arm.do(robot.MOVE_LINEAR, _tool(side * CARRY_M, ABOVE_M), VelocityProfile())


async def _pick(arm: CommandedArm) -> None:
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


TO_AND_FRO, WITH_PAUSES, GRIPS, CARRIES = "to and fro", "with pauses", "grips", "carries"
PROGRAMS: dict[str, Callable[[CommandedArm], Awaitable[None]]] = {
    TO_AND_FRO: to_and_fro,
    WITH_PAUSES: with_pauses,
    GRIPS: grips,
    CARRIES: carries,
}


TAKEN_OVER_S = 60.0
"""The lease of a commander that was killed runs out long before."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """Settings of a commander's process."""

    bus: ZenohConfig
    robot: RobotConfig
    program: str = TO_AND_FRO
    """One of `PROGRAMS`."""
    reports: Connection | None = None
    """Where each `Attempt` is sent to; None: nobody reads them."""


class DeafTask(Component):
    """A task that says that it ends, and goes on: what keeps the arm still must be the arm."""

    name = "decision"

    @implements(STOP_TASK)
    async def stop_task(self) -> bool:
        """Say that it ends."""
        return True


def start_commander(order: Order) -> BaseProcess:
    """Start one. What it needs is imported once for all of them, so that the next is there at once."""
    context: Any = multiprocessing.get_context("forkserver")
    # A process of the fork server runs the main module again, which imports what this one has imported.
    context.set_forkserver_preload([name for name in sys.modules if name.startswith("dlokit.")])
    process: BaseProcess = context.Process(target=_main, args=(order,), daemon=True, name="commander")
    process.start()
    return process


def pid_of(commander: BaseProcess) -> int:
    """Number of the process of a commander that was started."""
    assert commander.pid is not None, "it was started"
    return commander.pid


def end_commander(commander: BaseProcess) -> None:
    """Kill it, frozen or not."""
    commander.kill()
    commander.join()


def _main(order: Order) -> None:
    end_with_parent()
    logging.basicConfig(level=logging.WARNING)
    asyncio.run(_command(order))


def _reachable(guest: ZenohConfig) -> ZenohConfig:
    """The bus of a guest that serves skills: other guests, such as `dlokit stop`, meet it at a socket of its own."""
    assert guest.login is not None, "a bus on one machine asks for its key"
    folder = guest.connect[0].rpartition("/")[0]
    return replace(guest, listen=(f"{folder}/commander-{os.getpid()}",), accepts=(guest.login,))


async def _command(order: Order) -> None:
    async with join_bus(_reachable(order.bus), TimeBase.CELL) as bus:
        await bus.first_tick()
        host = Container(bus.transport, bus.clock)
        host.add(DeafTask())
        arm = CommandedArm(bus.transport, _reporter(order.reports))
        async with host, asyncio.timeout(None) as limit:
            limit.reschedule(asyncio.get_running_loop().time() + TAKEN_OVER_S)
            while True:
                try:
                    async with leases_held(bus.transport, bus.clock, order.robot):
                        limit.reschedule(None)
                        await PROGRAMS[order.program](arm)
                except ProcessFailure:
                    await asyncio.sleep(RETRY_S)


def _reporter(reports: Connection | None) -> Callable[[Attempt], None]:
    return (lambda attempt: None) if reports is None else reports.send
