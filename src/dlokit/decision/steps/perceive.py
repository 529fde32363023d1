"""The boxes that check the camera, look, compare and set the goal."""

import asyncio
import logging
from typing import Any

import numpy as np

from dlokit.communication import topics
from dlokit.decision.convergence import Progress, best_so_far, patience, progress
from dlokit.decision.looking import look_anew, settle, state_after, tell_observer
from dlokit.decision.steps.act import until_done
from dlokit.decision.steps.hands import hands_of, note_slip, stayed_behind
from dlokit.decision.steps.outcomes import RESTORABLE, Checked, GoalSet, Sight, explain, fail
from dlokit.decision.task import ActionRecord, CameraReport, ShapeTask
from dlokit.description.arm.mounts import instance_of
from dlokit.geometry import downward, rmse_m
from dlokit.skills.model import api as model
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.action import kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, GoalShape
from dlokit.types.flow import Command
from dlokit.types.outcome import Failed, Outcome, Succeeded

UNUSABLE = frozenset({"no_points", "out_of_view", "crossing", "fragmented"})
"""Reasons for which a first look gives no shape to work with, though everything works."""


def _judge_sight(task: ShapeTask, skill: str, outcome: Outcome[Any]) -> Sight:
    fail(task, skill, outcome)
    if isinstance(outcome, Failed) and outcome.reason in UNUSABLE:
        task.reason = f"start {explain(outcome)}"
        return Sight.UNUSABLE
    return _unseen(task)


def _unseen(task: ShapeTask) -> Sight:
    """Why nothing was seen: somebody is gone who will be back, or something else."""
    return Sight.LOST if task.lost in RESTORABLE else Sight.FAILED


def _not_set(task: ShapeTask) -> GoalSet:
    return GoalSet.LOST if task.lost in RESTORABLE else GoalSet.FAILED


async def find_dlo(task: ShapeTask) -> Sight:
    """First look: the shape is unknown, so the observer orders the cloud into nodes."""
    task.reason = None  # what was said of the camera
    if not await robots_out_of_the_way(task):
        return Sight.FAILED
    seen = await task.port.call(perception.LOOK)
    if not isinstance(seen, Succeeded):
        return _judge_sight(task, "perception.look", seen)
    first = await tell_observer(task, seen.result.stamp_ns)
    if not isinstance(first, Succeeded):
        return _judge_sight(task, "observer.initialise", first)
    task.state = await state_after(task, first.result.stamp_ns)
    if task.state is None:
        return _unseen(task)
    return Sight.SEEN


async def robots_out_of_the_way(task: ShapeTask) -> bool:
    """Bring all arms home; False (and a reason) where one is not there, or does not come home."""
    if not await _robot_speaks(task):
        return False
    for name in task.robots:
        instance = instance_of(name)
        home = await until_done(task, instance, robot.HOME)
        if not isinstance(home, Succeeded):
            fail(task, robot.HOME.at(instance).key, home)
            return False
    return True


async def _robot_speaks(task: ShapeTask) -> bool:
    for name in task.robots:
        try:
            async with asyncio.timeout(task.config.robot_timeout_s):
                async for _ in task.port.stream(topics.ROBOT_STATE.at(instance_of(name))):
                    break
        except TimeoutError:
            waited_s = task.config.robot_timeout_s
            task.reason = f"robot_lost: no state of the robot {name} came within {waited_s:g} s; is it running?"
            return False
    return True


async def set_goal(task: ShapeTask) -> GoalSet:
    """Put the goal into the model; the operator's from the viewer when none was given."""
    if task.request is None:
        await _operator_starts(task)
        if not await _take_goal_of_operator(task):
            return _not_set(task)
    else:
        request = task.request
        goal = await task.port.call(model.SET_GOAL, request.nodes_world, request.name, request.ends_interchangeable)
        if not isinstance(goal, Succeeded):
            fail(task, "model.set_goal", goal)
            return _not_set(task)
        task.goal = goal.result
    return await _label_ends(task)


async def _operator_starts(task: ShapeTask) -> None:
    async for message in task.commands:
        if message.command is Command.START:
            return


async def _take_goal_of_operator(task: ShapeTask) -> bool:
    """The goal that the frames pull the rod into, once it rests; without frames, the one that is set."""
    task.started_ns = task.port.clock.now_ns()  # the time that the operator took is not the task's
    frames = task.port.latest(topics.GOAL_FRAMES).value
    if frames is None:
        task.goal = task.port.latest(topics.GOAL).value
        if task.goal is None:
            task.reason = "no_goal: no goal was set; drag a frame, then press Shape it"
        return task.goal is not None
    built = await task.port.call(model.BUILD_GOAL, frames.frames)
    if not isinstance(built, Succeeded):
        fail(task, "model.build_goal", built)
        return False
    task.goal = built.result
    return True


async def _label_ends(task: ShapeTask) -> GoalSet:
    """Call that end node 0 which is nearer to the goal's node 0, once and for all.

    A camera cannot tell the ends of a rod apart, so which is first is ours to say; the order that is nearer to
    the goal spares turning the rod round. From here on the order is kept, and a goal that would fit the other
    way round does not count unless its ends are interchangeable.
    """
    assert task.state is not None
    assert task.goal is not None
    nodes, goal = task.state.nodes_world, task.goal.nodes_world
    if rmse_m(nodes, goal) <= rmse_m(nodes[::-1], goal):
        return GoalSet.SET
    reset = await task.port.call(model.RESET)
    if not isinstance(reset, Succeeded):
        fail(task, "model.reset", reset)
        return _not_set(task)
    turned = await tell_observer(task, expected_world=goal)
    if not isinstance(turned, Succeeded):
        fail(task, "observer.initialise", turned)
        return _not_set(task)
    task.state = await state_after(task, turned.result.stamp_ns)
    return GoalSet.SET if task.state is not None else _not_set(task)


async def track_model(task: ShapeTask) -> Sight:
    """The shape before the first action; may the task start from it?"""
    if not await settle(task):
        return _unseen(task)
    assert task.state is not None
    assert task.goal is not None
    verdict = await task.port.call(planning.CHECK_START, task.state)
    if not isinstance(verdict, Succeeded):
        fail(task, "planning.check_start", verdict)
        return Sight.FAILED
    # What a task that is resumed had done to the DLO is gone on from, as after any action.
    if not verdict.result.feasible and not task.start_accepted:
        problems = ", ".join(finding.problem.value for finding in verdict.result.findings)
        task.reason = f"start {problems}: {verdict.result.text}"
        return Sight.UNUSABLE
    task.start = task.state
    task.errors_m.append(_error(task))
    return Sight.SEEN


def _error(task: ShapeTask) -> float:
    assert task.state is not None
    assert task.goal is not None
    return _error_of(task.state.nodes_world, task.goal)


def _error_of(nodes_world: Float64Array, goal: GoalShape) -> float:
    return rmse_m(nodes_world, goal.nodes_world, ends_interchangeable=goal.ends_interchangeable)


async def compare(task: ShapeTask) -> Progress:
    """RMSE against the threshold, then the break conditions."""
    elapsed_s = (task.port.clock.now_ns() - task.started_ns) / 1e9
    verdict = progress(task.errors_m, elapsed_s, task.config, watched=task.watched)
    where = best_so_far(task.errors_m)
    match verdict:
        case Progress.OUT_OF_ACTIONS:
            task.reason = f"{task.config.max_actions} actions are spent; {where}"
        case Progress.OUT_OF_TIME:
            task.reason = f"{task.config.max_time_s:g} s are spent; {where}"
        case Progress.STALLED:
            task.reason = f"no better shape in {patience(task.config, watched=task.watched)} actions; {where}"
        case Progress.CONVERGED | Progress.NOT_YET:
            task.reason = None
    return verdict


async def track_again(task: ShapeTask) -> Sight:
    """The shape after an action; writes its record."""
    assert task.state is not None
    assert task.goal is not None
    robot_time_s = (task.port.clock.now_ns() - task.robot_started_ns) / 1e9
    path_length_m = task.odometer.travelled_m - task.tool_started_m
    await task.port.clock.sleep(task.config.settle_s)
    if not await look_anew(task, task.expected_world) or not await settle(task):
        return _unseen(task)
    if stayed_behind(task, task.state.nodes_world):
        for hand in hands_of(task.chosen):
            note_slip(task, hand.grasp.node)
    task.errors_m.append(_error(task))
    predicted = task.chosen.predicted_nodes_world
    record = ActionRecord(
        action=task.actions + 1,
        kind=kind_of(task.chosen),
        grasp_node=task.chosen.grasp.node,
        grasp_ok=task.grasp_ok,
        slipped=task.slipped,
        rmse_m=task.errors_m[-1],
        predicted_rmse_m=None if predicted is None else _error_of(predicted, task.goal),
        duration_s=(task.port.clock.now_ns() - task.action_started_ns) / 1e9,
        robot_time_s=robot_time_s,
        path_length_m=path_length_m,
        planning_time_s=task.decision_time_s,
        release_stamp_ns=task.release_stamp_ns,
        nodes_world=task.state.nodes_world,
        expected_world=predicted,
        path_world=np.array([pose.position_m for pose in (task.chosen.grasp.T_world_tcp, *task.chosen.path)]),
        corrections=tuple(task.corrections_seen),
        control_end=task.control_end,
        ended_by=task.ended_by,
    )
    task.belief = await _learnt(task) or task.belief
    task.history.append(record)
    task.recorded(record)
    return Sight.SEEN


async def _learnt(task: ShapeTask) -> DloBelief | None:
    """What the action said of the DLO; None where nothing is learnt, which stops nothing."""
    if not (task.config.learn and task.grasp_ok) or task.ended_by or task.before_world is None or task.state is None:
        return None
    said = await task.port.call(model.LEARN, task.before_world, task.state.nodes_world)
    return said.result if isinstance(said, Succeeded) else None


log = logging.getLogger(__name__)

_PLACES = ((0.50, 0.14, np.pi / 2), (0.50, -0.14, -np.pi / 2))
"""Where the first arm's hand is looked at: x, y [m] and yaw [rad]. Half a turn lies between the looks, so that errors
of the hand's model cancel; the farther apart, the better is the camera's turn told."""
_REST_S = 0.1
"""Wait for the arm to stand still before the pictures [s]."""


async def check_camera(task: ShapeTask) -> Checked:
    """Correct by the first arm's hand how far the camera is off along the table, or leave it and say why."""
    if not task.config.check_camera:
        return Checked.OFF
    if not await robots_out_of_the_way(task):
        return Checked.FAILED
    told = task.port.alive(perception.CHECK_CAMERA.component).server
    task.camera = await _report(task)
    task.place_known_by = "" if task.camera.check is None else told
    task.reason = task.camera.text  # told with the next box
    if task.camera.check is None:
        log.warning("%s", task.camera.text)
        return Checked.KEPT
    log.info("%s", task.camera.text)
    return Checked.CORRECTED


async def check_camera_unless_known(task: ShapeTask) -> None:
    """The same where perception is another process than the one that was told where the camera stands."""
    there = task.port.alive(perception.CHECK_CAMERA.component).server
    if not there or there != task.place_known_by:
        await check_camera(task)


async def _report(task: ShapeTask) -> CameraReport:
    """What the hand says of the camera."""
    why = await _shown(task)
    if why is None:
        checked = await task.port.call(perception.CHECK_CAMERA)
        if isinstance(checked, Succeeded):
            off_mm = 1e3 * float(np.linalg.norm(checked.result.offset_m))
            turn_deg = abs(float(np.degrees(checked.result.yaw_rad)))
            text = f"the camera was {off_mm:.1f} mm and {turn_deg:.2f}° off its calibration along the table; corrected"
            return CameraReport(text=text, check=checked.result)
        why = f"perception.check_camera {explain(checked)}"
    return CameraReport(text=f"the look at the hand failed, so the camera's place stays as calibrated: {why}")


async def _shown(task: ShapeTask) -> str | None:
    """Pictures without the hand, then of the hand at each place; why not, where that did not succeed."""
    name = task.robots[0]
    begun = await task.port.call(perception.NOTE_BACKGROUND)
    if not isinstance(begun, Succeeded):
        return f"perception.note_background {explain(begun)}"
    for x_m, y_m, yaw_rad in _PLACES:
        place = downward([x_m, y_m, task.config.check_height_m], yaw_rad)
        moved = await until_done(task, instance_of(name), robot.MOVE_TO, place, either_way=False)
        if not isinstance(moved, Succeeded):
            return f"robot.move_to {explain(moved)}"
        await task.port.clock.sleep(_REST_S)
        seen = await task.port.call(perception.SEE_HAND, name)
        if not isinstance(seen, Succeeded):
            return f"perception.see_hand {explain(seen)}"
    return None
