"""The steps after an arm braked, or a component or the decision process itself was lost."""

import asyncio
import logging

from dlokit.communication import topics
from dlokit.decision.faults import RESTORABLE
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import find
from dlokit.decision.records import GoalRequest
from dlokit.decision.steps import hands, put_down
from dlokit.decision.steps.outcomes import Done, Recovered, Restored
from dlokit.decision.steps.perceive import check_camera_unless_known
from dlokit.decision.task import ShapeTask
from dlokit.geometry import lifted
from dlokit.skills.model import api as model
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.action import APPROACH_HEIGHT_M, VelocityProfile

log = logging.getLogger(__name__)

_MOST_RESTORATIONS = 4
"""Times in one task that lost components are waited for."""
_RESTART_TIMEOUT_S = 180.0
"""Longest wait for a process to be started again [s of the machine's clock]; it may have kernels to compile."""
_NOTICED_S = 1.0
"""Time after which every process has noticed that another one is gone [s]."""
_ASKED_EVERY_S = 0.2
_HEARD_S = 0.3
"""Wait before a fault is cleared [s]: a process that was frozen sends its next heartbeat 0.1 s later at most. On the
machine's clock: after a freeze the cell's clock jumps ahead, and a wait on it would end at once."""


async def recover(task: ShapeTask) -> Recovered:
    """Clear the fault of an arm that braked on its own, a bounded number of times.

    An interrupted carry continues if the fingers still hold the DLO. Released in the middle of a lay-down
    it would fall from up to half a metre into a heap in which no camera can distinguish its ends.
    """
    if not hands.may_recover(task, task.fault):
        again = f"{len(task.spent.recoveries) + 1} times"
        if len(task.spent.recoveries) < hands.MOST_RECOVERIES:
            again = f"a second time in one action ({task.fault}), which needs a person to look at the arm"
        task.reason = f"the arm braked on its own {again}; the last time: {task.reason}"
        return Recovered.TOO_OFTEN
    hands.note_recovery(task, task.fault)
    await asyncio.sleep(_HEARD_S)
    await hands.clear_faults(task)
    if not hands.still_carry(task):
        return Recovered.DONE
    task.attempt.goes_on()
    return Recovered.CARRYING


async def restore(task: ShapeTask) -> Restored:
    """Wait until the lost components are alive again; then find the DLO, and resume the interrupted step."""
    lost = task.spent.interruptions
    lost.append(task.reason or "")
    if len(lost) > _MOST_RESTORATIONS:
        task.reason = f"components were lost {len(lost)} times; the last time: {task.reason}"
        return Restored.TOO_OFTEN
    log.warning("interrupted, and looking again: %s", task.reason)
    await _all_alive(task)
    if task.attempt_under_way is None:
        if task.request is None and task.goal_set is not None:  # the operator is not asked for it again
            task.request = GoalRequest.of(task.goal)
        return Restored.BEGIN
    try:
        await _send_again(task)
    except StepFault as fault:  # soon after a start any call may fail; it is repeated as after another loss
        raise StepFault(FaultKind.LOST, str(fault), reason=fault.reason) from None
    return Restored.LOOK_AGAIN


async def _all_alive(task: ShapeTask) -> None:
    try:
        async with asyncio.timeout(_RESTART_TIMEOUT_S):
            await asyncio.sleep(_NOTICED_S * len(task.spent.interruptions))  # longer after each failed restoration
            while _missing(task):  # noqa: ASYNC110  liveness has no event to wait for
                await asyncio.sleep(_ASKED_EVERY_S)
    except TimeoutError:
        missing = ", ".join(_missing(task))
        waited = f"{missing} not restarted within {_RESTART_TIMEOUT_S:g} s; {task.reason}"
        raise StepFault(FaultKind.FAILED, waited) from None


def _missing(task: ShapeTask) -> list[str]:
    return [component for component in RESTORABLE if not task.port.alive(component).alive]


async def _send_again(task: ShapeTask) -> None:
    """Send the goal to the model and the camera's pose to perception; initialise observer and model with the DLO."""
    goal = task.goal
    await task.ask(model.SET_GOAL, goal.nodes_world, goal.name, goal.ends_interchangeable, goal.beside)
    await task.port.call(perception.SET_TRACKING, 0.0)
    await check_camera_unless_known(task)
    seen = await task.ask(perception.LOOK)
    # In the previous direction: a camera cannot distinguish the ends.
    await find(task, seen.stamp_ns, task.attempt.expected_world)


async def take_over(task: ShapeTask) -> Done:
    """Clear faults, put down what the fingers hold, open them, and move straight up; one arm after the other."""
    for instance in task.instances:
        await task.ask(robot.RECOVER.at(instance))
        await _put_down(task, instance)
        closed = await hands.refused(task.ask(robot.RELEASE.at(instance)))  # beside a fixture they open above it
        state = task.port.latest(topics.ROBOT_STATE.at(instance)).value
        if state is None:
            continue  # the next step waits for its state
        up = lifted(state.T_world_tcp, APPROACH_HEIGHT_M)
        # Where straight up is refused, the joint-space move home has its own checks.
        await hands.refused(task.ask(robot.MOVE_LINEAR.at(instance), up, VelocityProfile()))
        if closed:
            await task.ask(robot.RELEASE.at(instance))
    return Done.DONE


async def _put_down(task: ShapeTask, instance: str) -> None:
    """Lower the DLO that a hand holds to the table, where the robot allows it; else it stays where it is."""
    arm, dlo = task.port.latest(topics.ROBOT_STATE.at(instance)).value, task.port.latest(topics.STATE).value
    if arm is None or not arm.holding or dlo is None:
        return
    paths = put_down.paths_down(dlo.nodes_world, arm.T_world_tcp, task.fixtures)
    # Where a second hand may hold the DLO too, each goes straight down.
    for path in paths if len(task.instances) == 1 else paths[-1:]:
        if not await hands.refused(task.ask(robot.FOLLOW_PATH.at(instance), path, put_down.VELOCITY)):
            return
