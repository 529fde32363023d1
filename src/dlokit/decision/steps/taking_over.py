"""The first box of a task that is resumed: the arm stands wherever it braked, and may hold the DLO."""

from dlokit.communication import topics
from dlokit.decision.steps.acting import judge_motion
from dlokit.decision.steps.explaining import fail
from dlokit.decision.steps.outcomes import Moved, TakenOver
from dlokit.decision.task import ShapeTask
from dlokit.description.arms import instance_of
from dlokit.geometry import lifted
from dlokit.skills.robot import api as robot
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Succeeded


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
