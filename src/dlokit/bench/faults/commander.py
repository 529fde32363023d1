"""A commander that does nothing but move the arm to and fro under its lease, in a process that may be killed."""

import asyncio
import logging
import multiprocessing
import sys
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from dlokit.communication import topics
from dlokit.communication.clock import Clock
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh_session import ZenohConfig
from dlokit.description.panda_data import PANDA_HOME_Q_RAD
from dlokit.errors import ProcessFailure
from dlokit.skills.robot import api as robot
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.joined_bus import join_bus
from dlokit.system.lease_keeper import leases_held
from dlokit.system.processes import TimeBase
from dlokit.system.worker import end_with_parent
from dlokit.types.outcome import Succeeded

log = logging.getLogger(__name__)

SWING_RAD = 2.4
"""Of the first joint, to either side of home, always to the farther one: a motion takes 1.4 s at least, long enough to
be interrupted at any moment of its first second."""
FIRST_TICK_S = 30.0
TAKEN_OVER_S = 60.0
"""The lease of a commander that was killed runs out long before."""
RETRY_S = 0.05


@dataclass(frozen=True, kw_only=True)
class Order:
    """What a commander's process is told."""

    bus: ZenohConfig
    robot: RobotConfig


def start_commander(order: Order) -> BaseProcess:
    """Start one. What it needs is imported once for all of them, so that the next is there at once."""
    context: Any = multiprocessing.get_context("forkserver")
    # A process of the fork server runs the main module again, which imports what this one has imported.
    context.set_forkserver_preload([name for name in sys.modules if name.startswith("dlokit.")])
    process: BaseProcess = context.Process(target=_main, args=(order,), daemon=True, name="commander")
    process.start()
    return process


def _main(order: Order) -> None:
    end_with_parent()
    logging.basicConfig(level=logging.WARNING)
    asyncio.run(_command(order))


async def _command(order: Order) -> None:
    async with join_bus(order.bus, TimeBase.CELL) as bus:
        await bus.first_tick(FIRST_TICK_S)
        async with asyncio.timeout(None) as limit:
            limit.reschedule(asyncio.get_running_loop().time() + TAKEN_OVER_S)
            while True:
                try:
                    async with leases_held(bus.transport, bus.clock, order.robot):
                        limit.reschedule(None)
                        await _to_and_fro(bus.transport, bus.clock)
                except ProcessFailure:
                    await asyncio.sleep(RETRY_S)


async def _to_and_fro(transport: Transport, clock: Clock) -> None:
    while True:
        arm = transport.latest(topics.ROBOT_STATE).value
        side = 1.0 if arm is None or arm.q_rad[0] < PANDA_HOME_Q_RAD[0] else -1.0
        goal = PANDA_HOME_Q_RAD + np.array([side * SWING_RAD, 0, 0, 0, 0, 0, 0])
        moved = await transport.call(robot.MOVE_JOINTS, goal)
        if isinstance(moved, Succeeded):
            continue
        log.info("the motion ended: %s", moved)
        await asyncio.sleep(RETRY_S)
        await transport.call(robot.RECOVER)
