"""A commander that makes the arm do one thing under its lease, in a process that may be killed."""

import asyncio
import logging
import multiprocessing
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from dlokit.bench.stop.attempts import Attempt
from dlokit.bench.stop.programs import PROGRAMS, RETRY_S, TO_AND_FRO, CommandedArm
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.decision.api import STOP_TASK
from dlokit.errors import ProcessFailure
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.lease_keeper import leases_held
from dlokit.system.processes.workers import end_with_parent
from dlokit.system.table import TimeBase

FIRST_TICK_S = 30.0
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


async def _command(order: Order) -> None:
    async with join_bus(order.bus, TimeBase.CELL) as bus:
        await bus.first_tick(FIRST_TICK_S)
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
