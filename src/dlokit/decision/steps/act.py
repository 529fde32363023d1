"""The boxes that choose, grasp, move, release and mark."""

import math
from collections.abc import Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np

from dlokit.communication.skill import Skill
from dlokit.decision.convergence import best_so_far, has_changed, worth_it
from dlokit.decision.steps import hands
from dlokit.decision.steps.hands import follow_while_held
from dlokit.decision.steps.outcomes import Carried, Change, Found, Grasped, Marked, Moved, Recovered, Released, fail
from dlokit.decision.task import ActionRecord, FailedPair, ShapeTask, still_marked
from dlokit.geometry import rmse_m
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import Action, Marks, Push, kind_of
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded
from dlokit.types.robot import Remedy, remedy_of

NOT_WORTH_IT = "not_worth_it"
"""The word of an action that control does not follow."""


async def choose_control(task: ShapeTask, action: Action) -> None:
    """Whether control follows the action that was proposed for the present shape."""
    task.corrections, task.corrections_seen, task.control_end, task.controlled = [], [], "", False
    if not task.config.control:
        return
    assert task.state is not None
    assert task.goal is not None
    missed = missed_m(task.history, kind_of(action))
    asked = await task.port.call(planning.FORESEE_CONTROL, task.state, task.goal, action, missed)
    task.controlled = isinstance(asked, Succeeded) and asked.result.follows
    task.control_end = "" if task.controlled else NOT_WORTH_IT


def missed_m(history: Sequence[ActionRecord], kind: str) -> float:
    """How far actions of a kind ended from what was predicted (RMS) [m]; 0 before the first.

    Those that missed the DLO, lost it, ended early, or were corrected on the way tell nothing.
    """
    squares = [
        rmse_m(done.nodes_world, done.expected_world) ** 2
        for done in history
        if done.kind == kind and done.expected_world is not None and _as_planned(done)
    ]
    return math.sqrt(float(np.mean(squares))) if squares else 0.0


def _as_planned(done: ActionRecord) -> bool:
    return done.grasp_ok and not done.slipped and not done.ended_by and not done.corrections


_MOVED = {Remedy.ANOTHER_TARGET: Moved.REFUSED, Remedy.RECOVER: Moved.INTERRUPTED, Remedy.NONE: Moved.FAILED}


def judge_motion(task: ShapeTask, skill: str, outcome: Outcome[Any]) -> Moved:
    """What became of a motion; why, where it was not done, is kept as the task's reason."""
    if isinstance(outcome, Succeeded):
        return Moved.DONE
    fail(task, skill, outcome)
    return _MOVED[_remedy(outcome)]


def _remedy(outcome: Outcome[Any]) -> Remedy:
    return remedy_of(outcome.reason) if isinstance(outcome, Failed | Rejected) else Remedy.NONE


def judge_action(task: ShapeTask, skill: str, outcome: Outcome[Any]) -> Moved:
    """As `judge_motion`, for a motion without which the action does not come to its planned end."""
    note_end(task, outcome)
    return judge_motion(task, skill, outcome)


def note_end(task: ShapeTask, outcome: Outcome[Any]) -> None:
    """Keep why a motion was not done as what ended the action under way; the first cause holds."""
    if isinstance(outcome, Failed | Rejected):
        task.ended_by = task.ended_by or outcome.reason


async def choose_grasp(task: ShapeTask) -> Found:
    """Best valid, unmarked grasp; the planner tries the next best where one is invalid."""
    assert task.state is not None
    assert task.goal is not None
    task.action_started_ns = task.port.clock.now_ns()
    task.grasp_ok = task.slipped = task.pushed = task.deadlock = False
    task.ended_by = ""
    began = task.stopwatch()
    invalid = {pair.node for pair in task.marks} | task.slippery
    marks = Marks(invalid_nodes=np.array(sorted(invalid), dtype=np.int64))
    proposed = await task.port.call(planning.PROPOSE, task.state, task.goal, marks)
    if isinstance(proposed, Succeeded):
        await choose_control(task, proposed.result)
    task.decision_time_s = task.stopwatch() - began
    task.planning_time_s += task.decision_time_s
    if isinstance(proposed, Succeeded):
        task.action = proposed.result
        task.robot_started_ns = task.port.clock.now_ns()
        task.tool_started_m = task.odometer.travelled_m
        task.before_world = task.state.nodes_world
        return _weigh(task, proposed.result)
    fail(task, "planning.propose", proposed)
    if isinstance(proposed, Failed) and proposed.reason == "no_valid_grasp":
        return Found.NONE_LEFT
    return Found.FAILED


def _weigh(task: ShapeTask, action: Action) -> Found:
    """Whether the action is worth doing, after others that brought no progress."""
    assert task.goal is not None
    goal, predicted, promised_m = task.goal, action.predicted_nodes_world, None
    if predicted is not None:
        promised_m = rmse_m(predicted, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)
    if worth_it(task.errors_m, promised_m, task.config):
        return Found.FOUND
    task.reason = f"no action is expected to bring the shape nearer; {best_so_far(task.errors_m)}"
    return Found.NO_GAIN


async def approach(task: ShapeTask) -> Moved:
    """Open the fingers and move above the grasp in joint space."""
    opened = await hands.open_fingers(task)
    if not isinstance(opened, Succeeded):
        return judge_action(task, "robot.release", opened)
    moved = judge_action(task, "robot.move_to", await hands.go_above(task))
    if moved is Moved.REFUSED and task.chosen.partner is not None:
        # One of the two may stand above its grasp already, in the way of what is chosen next.
        refused = task.reason
        home = judge_motion(task, "robot.home", await hands.go_home(task))
        if home is not Moved.DONE:
            return home if home is Moved.INTERRUPTED else Moved.FAILED
        task.reason = refused
    return moved


async def grasp(task: ShapeTask) -> Grasped:
    """Straight down and close; to push, the fingers are closed already and have nothing to feel."""
    match judge_action(task, "robot.move_linear", await hands.go_down(task)):
        case Moved.REFUSED:
            return Grasped.MISSED
        case Moved.INTERRUPTED:
            return Grasped.INTERRUPTED
        case Moved.FAILED:
            return Grasped.FAILED
        case Moved.DONE:
            pass
    if isinstance(task.chosen, Push):
        return Grasped.BESIDE
    gripped = await hands.close_fingers(task)
    if not isinstance(gripped, Succeeded):
        fail(task, "robot.grasp", gripped)
        return Grasped.FAILED
    task.grasp_ok = gripped.result.held
    return Grasped.HELD if task.grasp_ok else Grasped.MISSED


async def move_to_goal(task: ShapeTask) -> Carried:
    """Carry the node along the path while perception, observer and model follow the rod."""
    hands.say_gripped(task, held=True)
    await task.port.call(perception.SET_TRACKING, task.config.tracking_hz)
    try:
        moved = await follow_while_held(task)
    finally:
        await task.port.call(perception.SET_TRACKING, 0.0)
    if task.slipped:
        return Carried.SLIPPED
    match judge_action(task, "robot.follow_path", moved):
        case Moved.DONE:
            return Carried.TO_CONTROL if task.controlled else Carried.DONE
        case Moved.REFUSED:
            return Carried.REFUSED
        case Moved.INTERRUPTED:
            return Carried.INTERRUPTED
        case Moved.FAILED:
            return Carried.FAILED


async def push(task: ShapeTask) -> Moved:
    """Move the closed fingers along the path; what became of the rod is seen afterwards."""
    judged = judge_action(task, "robot.follow_path", await hands.follow_paths(task))
    task.pushed = judged is Moved.DONE
    return judged


async def release(task: ShapeTask) -> Released:
    """Open, go straight up, and leave the picture."""
    opened = await hands.open_fingers(task)
    if not isinstance(opened, Succeeded):
        return _judge_release(judge_motion(task, "robot.release", opened))
    task.release_stamp_ns = task.port.clock.now_ns()
    hands.say_gripped(task, held=False)
    retreated = judge_motion(task, "robot.move_linear", await hands.go_up(task))
    # Where straight up is refused, the joint-space move home has its own checks.
    if retreated not in (Moved.DONE, Moved.REFUSED):
        return _judge_release(retreated)
    return _judge_release(judge_motion(task, "robot.home", await hands.go_home(task)))


def _judge_release(moved: Moved) -> Released:
    match moved:
        case Moved.DONE:
            return Released.DONE
        case Moved.INTERRUPTED:
            return Released.INTERRUPTED
        case Moved.REFUSED | Moved.FAILED:
            return Released.FAILED


async def recover(task: ShapeTask) -> Recovered:
    """Clear the fault of an arm that braked by itself; not for ever."""
    task.recoveries += 1
    if task.recoveries > task.config.max_recoveries:
        task.reason = f"the arm braked by itself {task.recoveries} times; the last time: {task.reason}"
        return Recovered.TOO_OFTEN
    recovered = await hands.clear_faults(task)
    if isinstance(recovered, Succeeded):
        return Recovered.DONE
    fail(task, "robot.recover", recovered)
    return Recovered.FAILED


async def has_error_changed(task: ShapeTask) -> Change:
    """Compare the error with the one before the action."""
    before_m, after_m = task.errors_m[-2:]
    return Change.CHANGED if has_changed(before_m, after_m, task.config) else Change.UNCHANGED


async def clear_marks(task: ShapeTask) -> Marked:
    """Grasp points may be tried again, but for those that failed from a shape like the present one."""
    assert task.state is not None
    task.marks = still_marked(task.marks, task.state.nodes_world, task.config.alike_m)
    if task.deadlock:
        _mark(task)
    return Marked.DONE


async def mark_invalid(task: ShapeTask) -> Marked:
    """This grasp point led to nothing from this shape."""
    _mark(task)
    return Marked.DONE


def _mark(task: ShapeTask) -> None:
    assert task.state is not None
    for hand in hands.hands_of(task.chosen):
        task.marks.append(FailedPair(node=hand.grasp.node, nodes_world=task.state.nodes_world))


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
        if _remedy(moved) is not Remedy.RECOVER or task.recoveries >= task.config.max_recoveries:
            return moved
        task.recoveries += 1
        await task.port.clock.sleep(_STANDS_S)
        recovered = await task.port.call(robot.RECOVER.at(instance))
        if not isinstance(recovered, Succeeded):
            return recovered
