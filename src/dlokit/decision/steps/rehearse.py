"""The step of a dry run in place of an action: its motions, in software."""

import numpy as np

from dlokit.decision.convergence import error_m
from dlokit.decision.flow import StepFault
from dlokit.decision.steps import hands
from dlokit.decision.steps.outcomes import Done
from dlokit.decision.task import ShapeTask
from dlokit.skills.robot import api as robot
from dlokit.types.action import kind_of


async def rehearse(task: ShapeTask) -> Done:
    """Make all motions of the action with arms in software, and say what would have been done.

    The robot's component plans and checks each motion as in any run. The DLO is not watched meanwhile: it stays.
    Raises `StepFault` where a motion is refused; the arms in software are at home then.
    """
    before_m = task.odometer.travelled_m
    try:
        await hands.open_fingers(task)
        await hands.go_above(task)
        await hands.go_down(task)
        await hands.close_fingers(task)
        await hands.follow_paths(task)
        await hands.open_fingers(task)
        await hands.go_up(task)
        await hands.go_home(task)
    except StepFault:
        for instance in task.instances:
            await task.port.call(robot.HOME.at(instance))
        raise
    task.reason = _would_do(task, task.odometer.travelled_m - before_m)
    return Done.DONE


def _would_do(task: ShapeTask, path_m: float) -> str:
    """What the action is: kind, node, lift, path and prediction."""
    action = task.attempt.action
    heights_m = [pose.position_m[2] for pose in (action.grasp.T_world_tcp, *action.path)]
    lift_m = float(np.max(heights_m)) - heights_m[0]
    predicted = action.predicted_nodes_world
    ends = "" if predicted is None else f", to a predicted RMSE of {error_m(predicted, task.goal) * 1000:.1f} mm"
    return (
        f"the first action would be a {kind_of(action)} at node {action.grasp.node}, lifted by {lift_m * 1000:.0f} mm, "
        f"with a tool path of {path_m:.2f} m{ends}"
    )
