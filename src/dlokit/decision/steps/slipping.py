"""Noticing that the DLO slipped out: by the fingers on the way, and by what the camera sees afterwards."""

import asyncio

import numpy as np

from dlokit.communication import topics
from dlokit.decision.steps import hands
from dlokit.decision.steps.hands import Hand
from dlokit.decision.task import ShapeTask
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Outcome
from dlokit.types.robot import MotionResult

SLIPPED = "slipped"
"""The name of a slip as the end of an action."""
_STILL_M = 0.008  # a DLO no node of which moved by more than this has not moved, as far as a camera can tell
_MOVED_M = 0.03  # a tool that came to rest nearer than this to the grasp need not have moved the DLO visibly


async def follow_while_held(task: ShapeTask) -> Outcome[MotionResult]:
    """Follow the paths of the action; where a hand's fingers close on nothing all are stopped and the slip noted."""
    follow = asyncio.ensure_future(hands.follow_paths(task))
    watches = {
        asyncio.create_task(_fingers_close(task, hand), name=f"slip {hand.robot}"): hand
        for hand in hands.hands_of(task.chosen)
    }
    try:
        await asyncio.wait((follow, *watches), return_when=asyncio.FIRST_COMPLETED)
        lost = [hand for watch, hand in watches.items() if watch.done()]
        if lost and not follow.done():
            for hand in lost:
                note_slip(task, hand.grasp.node)
            await hands.stop(task)
        return await follow
    finally:
        for waiting in (follow, *watches):
            waiting.cancel()
        await asyncio.gather(follow, *watches, return_exceptions=True)


async def _fingers_close(task: ShapeTask, hand: Hand) -> None:
    """Return when fingers that held something hold nothing; a robot that does not feel it is not waited for."""
    held = False
    async for state in task.port.stream(topics.ROBOT_STATE.at(hand.instance)):
        if held and not state.holding:
            return
        held = held or state.holding
    await asyncio.Event().wait()  # the stream has ended: nothing more will be felt


def note_slip(task: ShapeTask, node: int) -> None:
    """The action under way has lost the DLO at that node; one that lost it twice is not grasped again."""
    task.slipped, task.ended_by = True, task.ended_by or SLIPPED
    task.slips[node] = task.slips.get(node, 0) + 1


def stayed_behind(task: ShapeTask, after_world: Float64Array) -> bool:
    """Whether the tool went away and the DLO, now lying as `after_world` (M, 3) [m], did not come with it.

    Of a carry that ended before its planned end it is not known how far the tool went: that one says nothing.
    """
    if not task.grasp_ok or task.ended_by or task.before_world is None:
        return False
    action = task.chosen
    way_m = np.linalg.norm(action.path[-1].position_m[:2] - action.grasp.T_world_tcp.position_m[:2])
    moved_m = np.linalg.norm((after_world - task.before_world)[:, :2], axis=1).max()
    return bool(way_m > _MOVED_M and moved_m < _STILL_M)
