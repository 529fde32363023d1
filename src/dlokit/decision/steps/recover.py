"""The boxes that go on after a loss: of a component that was started again, or of the decision process itself."""

import asyncio

from dlokit.communication import topics
from dlokit.decision.looking import state_after, tell_observer
from dlokit.decision.steps.act import judge_motion
from dlokit.decision.steps.outcomes import RESTORABLE, Moved, Restored, TakenOver, fail
from dlokit.decision.steps.perceive import check_camera_unless_known
from dlokit.decision.task import GoalRequest, ShapeTask
from dlokit.description.arm.mounts import instance_of
from dlokit.geometry import lifted
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Succeeded

_NOTICED_S = 1.0
"""By then everybody knows that a process is gone, and it is not taken for alive."""
_ASKED_EVERY_S = 0.2


async def restore(task: ShapeTask) -> Restored:
    """Wait until whoever was lost is there again; then find the DLO anew, and go on with what was under way."""
    task.restorations += 1
    if task.restorations > task.config.max_restorations:
        task.reason = f"components were lost {task.restorations} times; the last time: {task.reason}"
        return Restored.TOO_OFTEN
    if not await _all_there(task):
        return Restored.FAILED
    task.lost = ""
    if task.action is None:
        _keep_goal(task)
        return Restored.BEGIN
    return Restored.LOOK_AGAIN if await _tell(task) else Restored.LOST


async def _all_there(task: ShapeTask) -> bool:
    try:
        async with asyncio.timeout(task.config.restart_timeout_s):
            await asyncio.sleep(_NOTICED_S * task.restorations)  # the longer, the more often it was in vain
            while _missing(task):  # noqa: ASYNC110  a liveness is looked at, and wakes nobody
                await asyncio.sleep(_ASKED_EVERY_S)
    except TimeoutError:
        missing = ", ".join(_missing(task))
        task.reason = f"{missing} not there again within {task.config.restart_timeout_s:g} s; {task.reason}"
        return False
    return True


def _missing(task: ShapeTask) -> list[str]:
    return [component for component in RESTORABLE if not task.port.alive(component).alive]


def _keep_goal(task: ShapeTask) -> None:
    """The task begins anew, but the operator, who has set the goal, is not asked again."""
    if task.request is None and task.goal is not None:
        task.request = GoalRequest(
            nodes_world=task.goal.nodes_world,
            name=task.goal.name,
            ends_interchangeable=task.goal.ends_interchangeable,
        )


async def _tell(task: ShapeTask) -> bool:
    """The goal to the model; the camera's place to perception; the DLO, found anew, to observer and model.

    False when somebody does not answer.
    """
    assert task.goal is not None, "an action is chosen for a goal"
    goal = task.goal
    told = await task.port.call(model.SET_GOAL, goal.nodes_world, goal.name, goal.ends_interchangeable)
    if not isinstance(told, Succeeded):
        fail(task, model.SET_GOAL.key, told)
        return False
    await task.port.call(perception.SET_TRACKING, 0.0)
    await check_camera_unless_known(task)
    seen = await task.port.call(perception.LOOK)
    if not isinstance(seen, Succeeded):
        fail(task, perception.LOOK.key, seen)
        return False
    # In the direction that it lay in: a camera cannot tell the ends apart.
    found = await tell_observer(task, seen.result.stamp_ns, task.expected_world)
    if not isinstance(found, Succeeded):
        fail(task, observer.INITIALISE.key, found)
        return False
    task.state = await state_after(task, found.result.stamp_ns) or task.state
    return not task.lost


async def take_over(task: ShapeTask) -> TakenOver:
    """Clear faults, open the fingers where the arm stands, and go straight up; one arm after the other."""
    for name in task.robots:
        instance = instance_of(name)
        cleared = await task.port.call(robot.RECOVER.at(instance))
        if not isinstance(cleared, Succeeded):
            fail(task, robot.RECOVER.key, cleared)
            return TakenOver.FAILED
        opened = await task.port.call(robot.RELEASE.at(instance))
        if not isinstance(opened, Succeeded):
            fail(task, robot.RELEASE.key, opened)
            return TakenOver.FAILED
        state = task.port.latest(topics.ROBOT_STATE.at(instance)).value
        if state is None:
            continue  # the next box waits for it
        up = lifted(state.T_world_tcp, task.config.retreat_height_m)
        moved = await task.port.call(robot.MOVE_LINEAR.at(instance), up, VelocityProfile())
        # Where straight up is refused, the joint-space move home has its own checks.
        if judge_motion(task, robot.MOVE_LINEAR.key, moved) not in (Moved.DONE, Moved.REFUSED):
            return TakenOver.FAILED
    return TakenOver.DONE
