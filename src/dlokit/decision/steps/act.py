"""The steps that choose, grasp, move, release and mark; in a dry run, the step that makes the motions in software."""

import math
from collections.abc import Sequence

import numpy as np

from dlokit.decision.attempt import ActionAttempt
from dlokit.decision.convergence import best_so_far, error_m, has_changed, worth_it
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.records import ActionRecord
from dlokit.decision.steps import hands
from dlokit.decision.steps.outcomes import Carried, Change, Done, Found, Grasped
from dlokit.decision.task import ShapeTask
from dlokit.geometry import rmse_m
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import Action, kind_of
from dlokit.types.outcome import Succeeded

NOT_WORTH_IT = "not_worth_it"
"""`control_end` of an action that control does not follow."""
_TRACKING_HZ = 2.0
"""Rate of looks while the DLO is carried [Hz]."""
_ALIKE_M = 0.002
"""A failed grasp stays marked while the shape is nearer than this (RMSE) to the one from which it failed [m]. The paper
clears all marks on any change of the error."""


async def choose_grasp(task: ShapeTask) -> Found:
    """Best valid, unmarked grasp; the planner tries the next best when one is invalid."""
    began_ns, began_s = task.port.clock.now_ns(), task.stopwatch()
    if task.attempt_under_way is not None:
        task.attempt_under_way.under_way = False  # dropped for another action, e.g. out of reach: it does not count
    try:
        action = await task.ask(planning.PROPOSE, task.shape, task.goal, task.grasps.invalid())
        controlled = task.config.control and await _to_be_controlled(task, action)
    except StepFault as fault:
        if fault.reason != "no_valid_grasp":
            raise
        task.reason = str(fault)
        return Found.NONE_LEFT
    finally:
        planning_time_s = task.stopwatch() - began_s
        task.spent.planning_time_s += planning_time_s
    task.attempt_under_way = ActionAttempt(
        action=action,
        before_world=task.shape.nodes_world,
        began_ns=began_ns,
        chosen_ns=task.port.clock.now_ns(),
        tool_travelled_m=task.odometer.travelled_m,
        planning_time_s=planning_time_s,
        controlled=controlled,
        control_end=NOT_WORTH_IT if task.config.control and not controlled else "",
    )
    return _if_worth_it(task, action)


async def _to_be_controlled(task: ShapeTask, action: Action) -> bool:
    """Whether control follows the action that was proposed for the present shape."""
    missed = prediction_error_m(task.history, kind_of(action))
    asked = await task.port.call(planning.FORESEE_CONTROL, task.shape, task.goal, action, missed)
    return isinstance(asked, Succeeded) and asked.result.follows


def prediction_error_m(history: Sequence[ActionRecord], kind: str) -> float:
    """Prediction error of the executed actions of a kind (RMS) [m]; 0 before the first.

    Actions that missed the DLO, lost it, ended early, or were corrected do not count.
    """
    squares = [
        rmse_m(done.nodes_world, done.expected_world) ** 2
        for done in history
        if done.kind == kind and done.expected_world is not None and _as_planned(done)
    ]
    return math.sqrt(float(np.mean(squares))) if squares else 0.0


def _as_planned(done: ActionRecord) -> bool:
    return done.grasp_ok and not done.slipped and not done.ended_by and not done.corrections


def _if_worth_it(task: ShapeTask, action: Action) -> Found:
    """Whether the action is worth executing after earlier actions without progress."""
    predicted = action.predicted_nodes_world
    predicted_m = None if predicted is None else error_m(predicted, task.goal)
    unmet = task.unmet  # near the goal, its wish on posts is to be met, whatever becomes of the error
    if (unmet and task.errors_m[-1] < task.config.threshold_m) or worth_it(task.errors_m, predicted_m, task.config):
        return Found.FOUND
    task.reason = f"no action is predicted to reduce the error; {best_so_far(task.errors_m, unmet)}"
    return Found.NO_GAIN


async def approach(task: ShapeTask) -> Done:
    """Open the fingers and move above the grasp in joint space."""
    task.attempt.under_way = True
    await hands.open_fingers(task)
    try:
        await hands.go_above(task)
    except StepFault as fault:
        if fault.kind is FaultKind.REFUSED and task.attempt.action.partner is not None:
            await _send_home(task)
        raise
    return Done.DONE


async def _send_home(task: ShapeTask) -> None:
    """Move both arms of a pair home: one may already be above its grasp, where it blocks the next action."""
    try:
        await hands.go_home(task)
    except StepFault as fault:
        if fault.kind is FaultKind.REFUSED:  # neither arm can move away: another grasp would fail too
            raise StepFault(FaultKind.FAILED, str(fault), reason=fault.reason) from None
        raise


async def grasp(task: ShapeTask) -> Grasped:
    """Move straight down and close the fingers; to push, they are closed already and hold nothing."""
    await hands.go_down(task)
    if not task.attempt.action.facts.grasps:
        return Grasped.BESIDE
    task.attempt.grasp_ok = (await hands.close_fingers(task)).held
    return Grasped.HELD if task.attempt.grasp_ok else Grasped.MISSED


async def move_to_goal(task: ShapeTask) -> Carried:
    """Carry the node along the path while perception, observer and model follow the rod; or carry on with it."""
    interrupted, task.attempt.carrying = task.attempt.carrying, True
    if not interrupted:
        hands.publish_gripped(task, held=True)
    await task.port.call(perception.SET_TRACKING, _TRACKING_HZ)
    try:
        held = await hands.follow_while_held(task, interrupted=interrupted)
    finally:
        await task.port.call(perception.SET_TRACKING, 0.0)
    task.attempt.carrying = False
    if not held:
        return Carried.SLIPPED
    return Carried.TO_CONTROL if task.attempt.controlled else Carried.DONE


async def push(task: ShapeTask) -> Done:
    """Move the closed fingers along the path; the next look shows the effect on the rod."""
    await hands.follow_paths(task)
    task.attempt.pushed = True
    return Done.DONE


async def release(task: ShapeTask) -> Done:
    """Open the fingers, move straight up, and leave the picture."""
    task.attempt.carrying = False
    if await hands.refused(hands.open_fingers(task)):
        # Beside a fixture, as after a slip, the fingers open above it; what they still hold falls from there.
        await hands.go_up(task)
        await hands.open_fingers(task)
    task.attempt.release_stamp_ns = task.port.clock.now_ns()
    hands.publish_gripped(task, held=False)
    if fault := await hands.refused(hands.go_up(task)):  # the joint-space move home has its own checks
        task.reason = str(fault)
    await hands.go_home(task)
    return Done.DONE


async def has_error_changed(task: ShapeTask) -> Change:
    """Compare the error with the one before the action."""
    before_m, after_m = task.errors_m[-2:]
    return Change.CHANGED if has_changed(before_m, after_m) else Change.UNCHANGED


async def clear_marks(task: ShapeTask) -> Done:
    """Clear the marks of grasp points, except those that failed from a shape like the present one."""
    task.grasps.clear(task.shape.nodes_world, _ALIKE_M)
    if task.attempt.deadlock:
        await mark_invalid(task)
    return Done.DONE


async def mark_invalid(task: ShapeTask) -> Done:
    """Mark the grasp points of the action: from this shape they changed nothing."""
    nodes = [hand.grasp.node for hand in hands.arm_actions_of(task)]
    task.grasps.mark(nodes, task.shape.nodes_world)
    return Done.DONE


async def rehearse(task: ShapeTask) -> Done:
    """Make all motions of the action with arms in software, and report the action that would have been done.

    The robot's component plans and checks each motion as in any run. The DLO is not watched meanwhile: it stays.
    Raises `StepFault` when a motion is refused; the arms in software are at home then.
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
    """A summary of the action: kind, node, lift, path and prediction."""
    action = task.attempt.action
    heights_m = [pose.position_m[2] for pose in (action.grasp.T_world_tcp, *action.path)]
    lift_m = float(np.max(heights_m)) - heights_m[0]
    predicted = action.predicted_nodes_world
    ends = "" if predicted is None else f", to a predicted RMSE of {error_m(predicted, task.goal) * 1000:.1f} mm"
    return (
        f"the first action would be a {kind_of(action)} at node {action.grasp.node}, lifted by {lift_m * 1000:.0f} mm, "
        f"with a tool path of {path_m:.2f} m{ends}"
    )
