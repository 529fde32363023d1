"""Motions of a free arm: one that was broken off because a sign of life came late is told again."""

from typing import ParamSpec, TypeVar

from dlokit.communication.skill import Skill
from dlokit.decision.steps.acting import INTERRUPTIONS
from dlokit.decision.task import ShapeTask
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded

P = ParamSpec("P")
R = TypeVar("R")

_STANDS_S = 0.3
"""Wait after an arm has braked by itself: it stands then, and a sign of life has come that was late [s]."""


async def until_done(
    task: ShapeTask, instance: str, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs
) -> Outcome[R]:
    """Tell an arm that holds nothing to move, and again after it braked by itself; not for ever.

    Beside the flow's box `recover`, which must choose anew because a DLO may be held: here the same motion will do.
    Every time counts to the task's `max_recoveries`; the outcome of the last one is returned.
    """
    while True:
        moved = await task.port.call(skill.at(instance), *args, **kwargs)
        interrupted = isinstance(moved, Failed | Rejected) and moved.reason in INTERRUPTIONS
        if not interrupted or task.recoveries >= task.config.max_recoveries:
            return moved
        task.recoveries += 1
        await task.port.clock.sleep(_STANDS_S)
        recovered = await task.port.call(robot.RECOVER.at(instance))
        if not isinstance(recovered, Succeeded):
            return recovered
