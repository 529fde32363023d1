"""The steps that check the camera, look, and compare."""

import asyncio
import logging

import numpy as np

from dlokit.communication import topics
from dlokit.decision.attempt import record_of
from dlokit.decision.convergence import Progress, SoFar, error_m, progress
from dlokit.decision.faults import explain, result_of
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import find_from_scratch, look_and_reinitialise, settle
from dlokit.decision.records import CameraReport
from dlokit.decision.steps.hands import arm_actions_of, note_slip, stayed_behind, until_done
from dlokit.decision.steps.outcomes import Checked, Done, FixturesSeen, Sight
from dlokit.decision.task import ShapeTask
from dlokit.geometry import downward
from dlokit.skills.model import api as model
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.fixtures import ACCEPTED, FixtureSight
from dlokit.types.outcome import Succeeded

UNUSABLE = frozenset({"no_points", perception.TOO_MUCH_SEGMENTED, "out_of_view", "crossing", "fragmented"})
"""Reasons why the first look yields no usable shape, without a fault."""


async def find_dlo(task: ShapeTask) -> Sight:
    """First look: the shape is unknown, so the observer orders the cloud into nodes."""
    task.reason = None  # the result of the camera check
    await send_robots_home(task)
    try:
        await find_from_scratch(task)
    except StepFault as fault:
        if fault.reason not in UNUSABLE:
            raise
        task.reason = f"start {fault.why}"
        return Sight.UNUSABLE
    return Sight.SEEN


async def send_robots_home(task: ShapeTask) -> None:
    """Move all arms home. Raises `StepFault` when one does not answer, or cannot move home."""
    for name, instance in zip(task.robots, task.instances, strict=True):
        await _await_robot_state(task, name, instance)
    for instance in task.instances:
        home = robot.HOME.at(instance)
        result_of(home, await until_done(task, home))


async def _await_robot_state(task: ShapeTask, name: str, instance: str) -> None:
    waited_s = _ROBOT_TIMEOUT_S
    try:
        async with asyncio.timeout(waited_s):
            async for _ in task.port.stream(topics.ROBOT_STATE.at(instance)):
                return
    except TimeoutError:
        text = f"robot_lost: no state of the {name} arm came within {waited_s:g} s; is it running?"
        raise StepFault(FaultKind.FAILED, text) from None


async def track_model(task: ShapeTask) -> Sight:
    """Estimate the shape before the first action, and check whether the task may start from it."""
    await settle(task)
    verdict = await task.ask(planning.CHECK_START, task.shape)
    # A resumed task continues from the shape that its actions left, as after any action.
    if not verdict.feasible and not task.spent.start_accepted:
        problems = ", ".join(finding.problem.value for finding in verdict.findings)
        task.reason = f"start {problems}: {verdict.text}"
        return Sight.UNUSABLE
    task.start = task.shape
    task.errors_m.append(error_m(task.shape.nodes_world, task.goal))
    return Sight.SEEN


async def compare(task: ShapeTask) -> Progress:
    """Compare the RMSE with the threshold, and the sides of posts with the wish; then check the break conditions."""
    so_far = SoFar(
        errors_m=task.errors_m,
        elapsed_s=(task.port.clock.now_ns() - task.spent.started_ns) / 1e9,
        history=task.history,
        doubtful=task.goal_set is not None and task.goal_set.doubtful,
        unmet=task.unmet,
    )
    verdict, task.reason = progress(so_far, task.config)
    return verdict


async def track_again(task: ShapeTask) -> Done:
    """Estimate the shape after an action, and write the action's record."""
    attempt = task.attempt
    robot_time_s = (task.port.clock.now_ns() - attempt.chosen_ns) / 1e9
    path_m = task.odometer.travelled_m - attempt.tool_travelled_m
    await task.port.clock.sleep(_SETTLE_S)
    await look_and_reinitialise(task, attempt.expected_world)
    await settle(task)
    if stayed_behind(attempt, task.shape.nodes_world):
        for hand in arm_actions_of(task):
            note_slip(task, hand.grasp.node)
    now_ns = task.port.clock.now_ns()
    record = record_of(
        attempt, task.actions + 1, task.shape, task.goal, now_ns=now_ns, robot_time_s=robot_time_s, path_m=path_m
    )
    task.errors_m.append(record.rmse_m)
    await _learn(task)
    task.history.append(record)
    attempt.under_way = False
    task.recorded(record)
    return Done.DONE


async def _learn(task: ShapeTask) -> None:
    """Let the model learn from the action; a failure to learn does not end the task."""
    attempt = task.attempt
    if task.config.learn and attempt.grasp_ok and not attempt.ended_by:
        await task.port.call(model.LEARN, attempt.before_world, task.shape.nodes_world)


log = logging.getLogger(__name__)

_SETTLE_S = 0.5
"""Wait after the arm has left before looking [s]: the DLO comes to rest."""
_ROBOT_TIMEOUT_S = 10.0
"""Longest wait for a robot's first state [s]."""
_CHECK_HEIGHT_M = 0.15
"""Height of the tool centre point over the table while the camera looks at the hand [m]: clear of the DLO."""
_PLACES = ((0.50, 0.14, np.pi / 2), (0.50, -0.14, -np.pi / 2))
"""Poses at which the camera looks at the first arm's hand: x, y [m] and yaw [rad]. The yaws differ by half a turn, so
that errors of the hand's model cancel; the larger the distance, the more precise is the camera's rotation."""
_CORRECT_FIXTURES = (
    "Put each where it is described, or correct its description in the file of --fixtures or --installation; remove "
    "what is unknown, or describe it."
)
_REST_S = 0.1
"""Wait before the pictures, for the arm to come to rest [s]."""


async def check_fixtures(task: ShapeTask) -> FixturesSeen:
    """Look at what stands on the table: no arm moves where a fixture is not as believed."""
    if wrong := await wrong_fixtures(task):
        task.reason = wrong
        return FixturesSeen.OTHERWISE
    return FixturesSeen.AS_BELIEVED


async def wrong_fixtures(task: ShapeTask) -> str:
    """Look at the fixtures; which of them do not stand as believed, and what to do. Empty: all do, or are not seen."""
    for name, instance in zip(task.robots, task.instances, strict=True):
        await _await_robot_state(task, name, instance)
    check = await task.ask(perception.CHECK_FIXTURES)
    if hidden := [one.name for one in check.findings if one.sight is FixtureSight.NOT_SEEN]:
        log.warning("the camera does not see %s: nothing checks where they stand", ", ".join(hidden))
    wrong = [one.text for one in check.findings if one.sight not in ACCEPTED]
    return f"fixtures: {'; '.join(wrong)}. {_CORRECT_FIXTURES}" if wrong else ""


async def check_fixtures_again(task: ShapeTask) -> FixturesSeen:
    """The same with the corrected camera, and with the arms out of its picture."""
    await send_robots_home(task)
    return await check_fixtures(task)


async def check_camera(task: ShapeTask) -> Checked:
    """Correct the camera's position along the table by a look at the first arm's hand, or keep it and note why."""
    if not task.config.check_camera:
        return Checked.OFF
    await send_robots_home(task)
    name = perception.CHECK_CAMERA.component
    server = task.port.alive(name).server
    task.camera = await _report(task)
    task.servers[name] = "" if task.camera.check is None else server
    task.reason = task.camera.text  # published with the next step
    if task.camera.check is None:
        log.warning("%s", task.camera.text)
        return Checked.KEPT
    log.info("%s", task.camera.text)
    return Checked.CORRECTED


async def check_camera_unless_known(task: ShapeTask) -> None:
    """The same, if perception is not the process that received the camera's correction."""
    name = perception.CHECK_CAMERA.component
    server = task.port.alive(name).server
    if not server or server != task.servers.get(name, ""):
        await check_camera(task)


async def _report(task: ShapeTask) -> CameraReport:
    """The result of the camera check."""
    why = await _take_pictures(task)
    if why is None:
        checked = await task.port.call(perception.CHECK_CAMERA)
        if isinstance(checked, Succeeded):
            off_mm = 1e3 * float(np.linalg.norm(checked.result.offset_m))
            turn_deg = abs(float(np.degrees(checked.result.yaw_rad)))
            text = f"the camera was {off_mm:.1f} mm and {turn_deg:.2f}° off its calibration along the table; corrected"
            return CameraReport(text=text, check=checked.result)
        why = f"perception.check_camera {explain(checked)}"
    return CameraReport(text=f"the camera check failed, so the camera's position stays as calibrated: {why}")


async def _take_pictures(task: ShapeTask) -> str | None:
    """Take pictures without the hand, then of the hand at each pose; returns the reason of a failure, else None."""
    first = task.robots[0]
    begun = await task.port.call(perception.NOTE_BACKGROUND)
    if not isinstance(begun, Succeeded):
        return f"perception.note_background {explain(begun)}"
    for x_m, y_m, yaw_rad in _PLACES:
        place = downward([x_m, y_m, _CHECK_HEIGHT_M], yaw_rad)
        moved = await until_done(task, robot.MOVE_TO, place, either_way=False)
        if not isinstance(moved, Succeeded):
            return f"robot.move_to {explain(moved)}"
        await task.port.clock.sleep(_REST_S)
        seen = await task.port.call(perception.SEE_HAND, first)
        if not isinstance(seen, Succeeded):
            return f"perception.see_hand {explain(seen)}"
    return None
