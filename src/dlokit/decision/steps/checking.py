"""The box that checks the camera's place by looking at the robot's own hand."""

import logging

import numpy as np

from dlokit.decision.steps.explaining import explain
from dlokit.decision.steps.outcomes import Checked
from dlokit.decision.steps.repeating import until_done
from dlokit.decision.steps.seeing import robots_out_of_the_way
from dlokit.decision.task import CameraReport, ShapeTask
from dlokit.description.arms import instance_of
from dlokit.geometry import downward
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Succeeded

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
