"""What each box of the shape flow does: skill calls and nothing else."""

import enum

import numpy as np

from dlokit.communication import topics
from dlokit.decision.convergence import Progress, has_changed, progress
from dlokit.decision.looking import settle, state_after
from dlokit.decision.task import ActionRecord, ShapeTask
from dlokit.geometry import matrix, pose_from_matrix, rmse_m
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import Marks, PickPlace
from dlokit.types.flow import Command, OperatorCommand
from dlokit.types.observation import Gripped
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded
from dlokit.types.pose import Pose


class Sight(enum.Enum):
    """What a look gave."""

    SEEN = "seen"
    UNUSABLE = "unusable"
    FAILED = "failed"


class GoalSet(enum.Enum):
    """What became of the goal."""

    SET = "set"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


class Found(enum.Enum):
    """Whether a grasp was found."""

    FOUND = "valid"
    NONE_LEFT = "none_left"
    FAILED = "failed"


class Moved(enum.Enum):
    """What became of a motion."""

    DONE = "done"
    REFUSED = "refused"
    FAILED = "failed"


class Grasped(enum.Enum):
    """What the fingers felt."""

    HELD = "held"
    MISSED = "missed"
    FAILED = "failed"


class Released(enum.Enum):
    """What became of the release."""

    DONE = "done"
    FAILED = "failed"


class Change(enum.Enum):
    """Whether an action changed the error."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"


class Marked(enum.Enum):
    """Book-keeping has one outcome."""

    DONE = "done"


REFUSALS = frozenset(
    {
        "unreachable",
        "joint_limit",
        "velocity_limit",
        "acceleration_limit",
        "jerk_limit",
        "table_collision",
        "self_collision",
    }
)
"""Reasons for which the robot refuses a motion before it moves: another grasp may do."""


def _explain(outcome: Outcome[object]) -> str:
    match outcome:
        case Failed(reason=reason, detail=detail) | Rejected(reason=reason, detail=detail):
            return f"{reason}: {detail}" if detail else reason
        case _:
            return f"{type(outcome).__name__.lower()}"


def _fail(task: ShapeTask, skill: str, outcome: Outcome[object]) -> None:
    task.reason = f"{skill} {_explain(outcome)}"


def _judge_motion(task: ShapeTask, skill: str, outcome: Outcome[object]) -> Moved:
    if isinstance(outcome, Succeeded):
        return Moved.DONE
    _fail(task, skill, outcome)
    if isinstance(outcome, Failed | Rejected) and outcome.reason in REFUSALS:
        return Moved.REFUSED
    return Moved.FAILED


async def find_dlo(task: ShapeTask) -> Sight:
    """First look: the shape is unknown, so the observer orders the cloud into nodes."""
    home = await task.port.call(robot.HOME)
    if not isinstance(home, Succeeded):
        _fail(task, "robot.home", home)
        return Sight.FAILED
    seen = await task.port.call(perception.LOOK)
    if not isinstance(seen, Succeeded):
        _fail(task, "perception.look", seen)
        return Sight.FAILED
    first = await task.port.call(observer.INITIALISE)
    if not isinstance(first, Succeeded):
        _fail(task, "observer.initialise", first)
        return Sight.FAILED
    task.state = await state_after(task, first.result.stamp_ns)
    if task.state is None:
        return Sight.FAILED
    return Sight.SEEN


async def set_goal(task: ShapeTask) -> GoalSet:
    """Put the goal into the model; the operator's from the viewer when none was given."""
    if task.request is None:
        await _operator_starts(task)
        task.goal = task.port.latest(topics.GOAL).value
        if task.goal is None:
            task.reason = "no goal was set: drag a frame before pressing start"
            return GoalSet.FAILED
    else:
        request = task.request
        goal = await task.port.call(model.SET_GOAL, request.nodes_world, request.name, request.ends_interchangeable)
        if not isinstance(goal, Succeeded):
            _fail(task, "model.set_goal", goal)
            return GoalSet.FAILED
        task.goal = goal.result
    verdict = await task.port.call(planning.CHECK_GOAL, task.goal)
    if not isinstance(verdict, Succeeded):
        _fail(task, "planning.check_goal", verdict)
        return GoalSet.FAILED
    if not verdict.result.feasible:
        task.reason = f"goal {verdict.result.reason}: {verdict.result.text}"
        return GoalSet.INFEASIBLE
    return GoalSet.SET


async def _operator_starts(task: ShapeTask) -> None:
    async for message in task.commands:
        if isinstance(message, OperatorCommand) and message.command is Command.START:
            return


async def track_model(task: ShapeTask) -> Sight:
    """The shape before the first action; may the task start from it?"""
    if not await settle(task):
        return Sight.FAILED
    assert task.state is not None
    assert task.goal is not None
    verdict = await task.port.call(planning.CHECK_START, task.state)
    if not isinstance(verdict, Succeeded):
        _fail(task, "planning.check_start", verdict)
        return Sight.FAILED
    if not verdict.result.feasible:
        task.reason = f"start {verdict.result.reason}: {verdict.result.text}"
        return Sight.UNUSABLE
    task.start = task.state
    task.errors_m.append(_error(task))
    return Sight.SEEN


def _error(task: ShapeTask) -> float:
    assert task.state is not None
    assert task.goal is not None
    return rmse_m(task.state.nodes_world, task.goal.nodes_world, ends_interchangeable=task.goal.ends_interchangeable)


async def compare(task: ShapeTask) -> Progress:
    """RMSE against the threshold, then the break conditions."""
    elapsed_s = (task.port.clock.now_ns() - task.started_ns) / 1e9
    verdict = progress(task.errors_m, elapsed_s, task.config)
    best = min(task.errors_m)
    where = f"best RMSE {best * 1e3:.1f} mm after action {task.errors_m.index(best)}"
    match verdict:
        case Progress.OUT_OF_ACTIONS:
            task.reason = f"{task.config.max_actions} actions are spent; {where}"
        case Progress.OUT_OF_TIME:
            task.reason = f"{task.config.max_time_s:g} s are spent; {where}"
        case Progress.STALLED:
            task.reason = f"no better shape in {task.config.stall_actions} actions; {where}"
        case Progress.CONVERGED | Progress.NOT_YET:
            task.reason = None
    return verdict


async def choose_grasp(task: ShapeTask) -> Found:
    """Best valid, unmarked grasp; the planner tries the next best where one is invalid."""
    assert task.state is not None
    assert task.goal is not None
    task.action_started_ns = task.port.clock.now_ns()
    began = task.stopwatch()
    marks = Marks(invalid_nodes=np.array(sorted(task.marks), dtype=np.int64))
    proposed = await task.port.call(planning.PROPOSE, task.state, task.goal, marks)
    task.planning_time_s += task.stopwatch() - began
    if isinstance(proposed, Succeeded):
        task.action = proposed.result
        return Found.FOUND
    _fail(task, "planning.propose", proposed)
    if isinstance(proposed, Failed) and proposed.reason == "no_valid_grasp":
        return Found.NONE_LEFT
    return Found.FAILED


def _above(pose: Pose, height_m: float) -> Pose:
    T = matrix(pose)
    T[2, 3] += height_m
    return pose_from_matrix(T)


def _action(task: ShapeTask) -> PickPlace:
    assert task.action is not None, "a grasp is chosen before the robot moves"
    return task.action


async def approach(task: ShapeTask) -> Moved:
    """Open the fingers and move above the grasp in joint space."""
    grasp_at = _action(task).grasp
    opened = await task.port.call(robot.RELEASE, grasp_at.opening_m)
    if not isinstance(opened, Succeeded):
        return _judge_motion(task, "robot.release", opened)
    moved = await task.port.call(robot.MOVE_TO, _above(grasp_at.T_world_tcp, task.config.approach_height_m))
    return _judge_motion(task, "robot.move_to", moved)


async def grasp(task: ShapeTask) -> Grasped:
    """Straight down and close."""
    action = _action(task)
    down = await task.port.call(robot.MOVE_LINEAR, action.grasp.T_world_tcp, action.velocity)
    match _judge_motion(task, "robot.move_linear", down):
        case Moved.REFUSED:
            return Grasped.MISSED
        case Moved.FAILED:
            return Grasped.FAILED
        case Moved.DONE:
            pass
    gripped = await task.port.call(robot.GRASP, task.config.grasp_force_n)
    if not isinstance(gripped, Succeeded):
        _fail(task, "robot.grasp", gripped)
        return Grasped.FAILED
    task.grasp_ok = gripped.result.held
    return Grasped.HELD if task.grasp_ok else Grasped.MISSED


async def move_to_goal(task: ShapeTask) -> Moved:
    """Carry the node along the path while perception, observer and model follow the rod."""
    action = _action(task)
    _say_gripped(task, action.grasp.node)
    await task.port.call(perception.SET_TRACKING, task.config.tracking_hz)
    try:
        moved = await task.port.call(robot.FOLLOW_PATH, action.path, action.velocity)
    finally:
        await task.port.call(perception.SET_TRACKING, 0.0)
    return _judge_motion(task, "robot.follow_path", moved)


def _say_gripped(task: ShapeTask, node: int | None) -> None:
    robot_name = _action(task).robot
    task.port.publish(topics.GRIPPED, Gripped(stamp_ns=task.port.clock.now_ns(), robot=robot_name, node=node))


async def release(task: ShapeTask) -> Released:
    """Open, go straight up, and leave the picture."""
    action = _action(task)
    opened = await task.port.call(robot.RELEASE, action.grasp.opening_m)
    if not isinstance(opened, Succeeded):
        _fail(task, "robot.release", opened)
        return Released.FAILED
    task.release_stamp_ns = task.port.clock.now_ns()
    _say_gripped(task, None)
    state = task.port.latest(topics.ROBOT_STATE).value
    if state is not None:
        up = _above(state.T_world_tcp, task.config.retreat_height_m)
        moved = await task.port.call(robot.MOVE_LINEAR, up, action.velocity)
        if _judge_motion(task, "robot.move_linear", moved) is Moved.FAILED:
            return Released.FAILED
    home = await task.port.call(robot.HOME)
    if not isinstance(home, Succeeded):
        _fail(task, "robot.home", home)
        return Released.FAILED
    task.reason = None
    return Released.DONE


async def track_again(task: ShapeTask) -> Sight:
    """The shape after an action; writes its record."""
    await task.port.clock.sleep(task.config.settle_s)
    if not await settle(task):
        return Sight.FAILED
    assert task.state is not None
    task.errors_m.append(_error(task))
    task.history.append(
        ActionRecord(
            action=len(task.history) + 1,
            grasp_node=_action(task).grasp.node,
            grasp_ok=task.grasp_ok,
            rmse_m=task.errors_m[-1],
            duration_s=(task.port.clock.now_ns() - task.action_started_ns) / 1e9,
            release_stamp_ns=task.release_stamp_ns,
            nodes_world=task.state.nodes_world,
        )
    )
    return Sight.SEEN


async def has_error_changed(task: ShapeTask) -> Change:
    """Compare the error with the one before the action."""
    return Change.CHANGED if has_changed(*task.errors_m[-2:], task.config) else Change.UNCHANGED


async def clear_marks(task: ShapeTask) -> Marked:
    """All grasp points may be tried again."""
    task.marks.clear()
    return Marked.DONE


async def mark_invalid(task: ShapeTask) -> Marked:
    """This grasp point led to nothing."""
    task.marks.add(_action(task).grasp.node)
    return Marked.DONE
