"""The time at which a fault is injected, drawn from the seed of the case and the kind given in its row."""

import asyncio
import enum
import math
import time
from collections.abc import Coroutine
from typing import Any

import numpy as np

from dlokit.communication.container import end_tasks
from dlokit.types.robot import RobotMode
from parts.live_run import LOOK_EVERY_S, LiveRun


class Moment(enum.Enum):
    """State of the run when the fault is injected."""

    ANY = "at any time of the task"
    MOVING = "while the arm moves"
    HOLDING = "while the DLO is carried"
    THINKING = "while the next action is chosen"
    ENDED = "when the task has ended, and its files are not written yet"
    LOOKING = "while the camera looks"


FIRST_S = 20.0
"""Latest injection after the first step [s of the cell's clock]; a task of one action takes longer."""
MOTIONS = 6
"""Minimum number of arm motions in a task of one action; the fault is injected in one of them."""
INTO_MOTION_S = 0.6
STEPS = {
    Moment.HOLDING: (frozenset({"move_to_goal"}), 0.5, 1.5),
    Moment.THINKING: (frozenset({"choose_grasp"}), 0.0, 1.0),
}
"""Steps of the flow, and how long after their beginning the fault is injected: from and to [s of the cell's clock]."""
LOOKING = frozenset({"find_dlo", "track_model", "track_again"})
LOOKS = 3
"""Steps that look, in a task of one action."""


async def comes(moment: Moment, run: LiveRun, rng: np.random.Generator) -> bool:
    """Wait for the moment; False when the task, or for `ENDED` the run, ended before it."""
    if moment is Moment.ENDED:
        await run.flow.end()
        return run.program.exit_code is None
    return not await ends_first(run, _wait(moment, run, rng))


async def ends_first(run: LiveRun, waiting: Coroutine[Any, Any, object]) -> bool:
    """Wait for an event or the end of the run; True if the run has ended or the event returned False."""
    awaited = asyncio.create_task(waiting)
    ended = asyncio.create_task(_ended(run))
    try:
        await asyncio.wait({awaited, ended}, return_when=asyncio.FIRST_COMPLETED)
        return ended.done() or awaited.result() is False
    finally:
        await end_tasks(awaited, ended)


async def _ended(run: LiveRun) -> None:
    while not run.flow.ended and run.program.exit_code is None:  # noqa: ASYNC110  an exit code wakes nobody
        await asyncio.sleep(LOOK_EVERY_S)


async def _wait(moment: Moment, run: LiveRun, rng: np.random.Generator) -> bool:
    await run.flow.begun()
    if moment is Moment.MOVING:
        await _moves(run, rng)
    elif moment is Moment.LOOKING:
        return await run.flow.comes_to(LOOKING, int(rng.integers(1, LOOKS + 1)))
    elif moment is Moment.ANY:
        await run.bus.clock.sleep(float(rng.uniform(0.0, FIRST_S)))
    else:
        steps, from_s, to_s = STEPS[moment]
        if not await run.flow.comes_to(steps):
            return False
        await run.bus.clock.sleep(float(rng.uniform(from_s, to_s)))
        return run.flow.step in steps
    return True


async def _moves(run: LiveRun, rng: np.random.Generator) -> None:
    """Wait for a random time in one of the first motions, while the arm still moves."""
    skipped = int(rng.integers(MOTIONS))
    while True:
        await run.arm.until_mode(RobotMode.MOVING, after_s=time.monotonic(), within_s=math.inf)
        if skipped > 0:
            skipped -= 1
            continue
        await run.bus.clock.sleep(float(rng.uniform(0.0, INTO_MOTION_S)))
        if run.arm.mode is RobotMode.MOVING:
            return
