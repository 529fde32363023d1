"""The step `control`: reduces the remaining error in closed loop while the DLO is held."""

import msgspec

from dlokit.communication import topics
from dlokit.decision.faults import explain
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import settle
from dlokit.decision.records import CorrectionRecord
from dlokit.decision.steps.outcomes import Controlled
from dlokit.decision.task import ShapeTask
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import ControlAdvice, ControlVerdict, GraspedNode
from dlokit.types.outcome import Succeeded

MOST_CORRECTIONS = 4
"""Maximum number of corrections per grasp: control must end if the error does not fall."""


async def control(task: ShapeTask) -> Controlled:
    """Look at the held DLO, and make one correction or note why none is made."""
    attempt = task.attempt
    advice = await _advice(task)
    if isinstance(advice, str):
        return _ends(task, Controlled.SETTLED, advice)
    if attempt.corrections_seen:  # the effect of the previous correction, now that the camera has seen it
        attempt.corrections_seen[-1] = msgspec.structs.replace(attempt.corrections_seen[-1], seen_m=advice.rmse_m)
    if advice.verdict is ControlVerdict.DEADLOCK:
        return _ends(task, Controlled.DEADLOCK, advice.reason)
    if advice.correction is None:
        return _ends(task, Controlled.SETTLED, advice.reason)
    if len(attempt.corrections) >= MOST_CORRECTIONS:
        return _ends(task, Controlled.SETTLED, "corrections_spent")
    try:
        await task.ask(robot.MOVE_LINEAR, advice.target, attempt.action.velocity)
    except StepFault as fault:
        if fault.kind is not FaultKind.REFUSED:
            raise
        task.reason = str(fault)
        return _ends(task, Controlled.DEADLOCK, "out_of_reach")
    attempt.corrections.append(advice.correction)
    x_m, y_m, z_m, yaw_rad = advice.correction.displacement.tolist()
    attempt.corrections_seen.append(
        CorrectionRecord(
            x_m=x_m,
            y_m=y_m,
            z_m=z_m,
            yaw_rad=yaw_rad,
            before_m=advice.rmse_m,
            predicted_m=advice.then_rmse_m,
        )
    )
    return Controlled.CORRECTED


async def _advice(task: ShapeTask) -> ControlAdvice | str:
    """The controller's advice for the observed shape, or the reason why control ends."""
    try:
        await settle(task)
    except StepFault as fault:
        task.reason = str(fault)
        return "not_seen"
    arm = task.port.latest(topics.ROBOT_STATE).value
    if arm is None or not arm.holding:
        return "not_held"
    grip = GraspedNode(node=task.attempt.action.grasp.node, T_world_tcp=arm.T_world_tcp)
    began_s = task.stopwatch()
    advice = await task.port.call(
        planning.CORRECT, task.shape, task.goal, grip, tuple(task.attempt.corrections), task.config.threshold_m
    )
    task.spent.planning_time_s += task.stopwatch() - began_s
    return advice.result if isinstance(advice, Succeeded) else explain(advice)


def _ends(task: ShapeTask, outcome: Controlled, why: str) -> Controlled:
    task.attempt.control_end, task.attempt.deadlock = why, outcome is Controlled.DEADLOCK
    return outcome
