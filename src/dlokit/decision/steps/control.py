"""The box that controls: the error that is left while the DLO is held, reduced in closed loop."""

import msgspec

from dlokit.communication import topics
from dlokit.decision.looking import settle
from dlokit.decision.steps.act import judge_motion, note_end
from dlokit.decision.steps.outcomes import Controlled, Moved, explain
from dlokit.decision.task import CorrectionRecord, ShapeTask
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import ControlAdvice, ControlVerdict, HeldNode
from dlokit.types.outcome import Succeeded


async def control(task: ShapeTask) -> Controlled:
    """Look at the DLO while it is held, and do one correction, or say why there is none to do."""
    advice = await _advice(task)
    if advice is None:
        return Controlled.SETTLED
    _see(task, advice)
    if advice.verdict is ControlVerdict.DEADLOCK:
        return _ends(task, Controlled.DEADLOCK, advice.reason)
    if advice.correction is None:
        return _ends(task, Controlled.SETTLED, advice.reason)
    if len(task.corrections) >= task.config.max_corrections:
        return _ends(task, Controlled.SETTLED, "corrections_spent")
    moved = await task.port.call(robot.MOVE_LINEAR, advice.target, task.chosen.velocity)
    match judge_motion(task, "robot.move_linear", moved):
        case Moved.DONE:
            task.corrections.append(advice.correction)
            task.corrections_seen.append(
                CorrectionRecord(
                    displacement=advice.correction.displacement,
                    before_m=advice.rmse_m,
                    predicted_m=advice.then_rmse_m,
                    seen_m=None,
                )
            )
            return Controlled.CORRECTED
        case Moved.REFUSED:
            return _ends(task, Controlled.DEADLOCK, "out_of_reach")
        case Moved.INTERRUPTED:
            note_end(task, moved)
            return Controlled.INTERRUPTED
        case Moved.FAILED:
            return Controlled.FAILED


async def _advice(task: ShapeTask) -> ControlAdvice | None:
    """The controller's word on what is seen now; None, and why control ends, where it has none."""
    assert task.goal is not None
    seen = await settle(task)
    arm = task.port.latest(topics.ROBOT_STATE).value
    if not seen or task.state is None or arm is None or not arm.holding:
        _ends(task, Controlled.SETTLED, "not_held" if seen else "not_seen")
        return None
    grip = HeldNode(node=task.chosen.grasp.node, T_world_tcp=arm.T_world_tcp)
    began = task.stopwatch()
    said = await task.port.call(
        planning.CORRECT, task.state, task.goal, grip, tuple(task.corrections), task.config.threshold_m
    )
    task.planning_time_s += task.stopwatch() - began
    if isinstance(said, Succeeded):
        return said.result
    _ends(task, Controlled.SETTLED, explain(said))
    return None


def _see(task: ShapeTask, advice: ControlAdvice) -> None:
    """What became of the correction before, now that the camera has seen it."""
    if not task.corrections_seen:
        return
    task.corrections_seen[-1] = msgspec.structs.replace(task.corrections_seen[-1], seen_m=advice.rmse_m)


def _ends(task: ShapeTask, outcome: Controlled, why: str) -> Controlled:
    task.control_end, task.deadlock = why, outcome is Controlled.DEADLOCK
    return outcome
