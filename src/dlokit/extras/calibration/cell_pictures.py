"""Pictures of a calibration board in the simulated cell, in the arm's hand or on the table.

A calibration gets the same input as from real hardware: pictures, and the state that the arm reports.
"""

import asyncio
import tempfile
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ParamSpec, TypeVar

import msgspec

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.description.shapes import builtin_shape
from dlokit.errors import HardwareError
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cell.config import CellBoard
from dlokit.geometry.camera import centred_camera
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.lockstep import LockstepSystem, lockstep_system
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.outcome import Succeeded
from dlokit.types.robot import RobotState

P = ParamSpec("P")
R = TypeVar("R")

CAMERA_LATE_S, CAMERA_DRIFT_PPM = 0.08, 50.0
"""Latency in the cell that `dlokit calibrate latency` must find, typical of a slow USB camera [s], and a drift that
must not affect the result, typical of a quartz at the edge of its tolerance."""
REST_S = 0.5
"""Time for the arm to come to rest before a picture [s]."""
_BEFORE_MOTION_S = 0.7
"""Time at rest before and after a motion whose states are compared with pictures [s]: the range of the search."""
_BETWEEN_PICTURES_S = 0.04
"""Pause between two pictures of a motion [s]."""
_CAPTURE_S = 5.0

Plan = Callable[[CameraCalibration], Sequence[Float64Array]]
"""Joint angles (7,) [rad] in which the arm shows the board, from the camera's approximate pose."""
Progress = Callable[[int, int], None]
"""Called before each picture with its number from 1 and the total."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardPicture:
    """A picture of the board, and the state of the arm that holds it."""

    images: CameraPictures
    robot: RobotState | None
    """State of the arm; None: the board is on the table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PicturesInMotion:
    """Pictures of a board in the hand of a moving arm, and the states of the arm during the motion."""

    images: Sequence[CameraPictures]
    states: Sequence[RobotState]


@dataclass(frozen=True, kw_only=True)
class CheckedPoses:
    """Result of a dry run of a calibration."""

    poses: int
    refused: tuple[str, ...]
    """One line for each pose to which a motion is refused, with the reason."""
    duration_s: float
    """Duration of all motions with their pauses on the arm's clock [s]."""


def cell_config(seed: int, *, held: bool, lens_distortion: bool, separate_cameras: bool = False) -> RunConfig:
    """The cell with a board, in the hand of the arm or on the table."""
    run = RunConfig(seed=seed, headless=True, record=False)
    cell = replace(
        run.cell, board=CellBoard(held=held), lens_distortion=lens_distortion, separate_cameras=separate_cameras
    )
    return replace(run, cell=cell)


def late(run: RunConfig) -> RunConfig:
    """The cell with a camera that has a drifting clock and late pictures."""
    return replace(run, cell=replace(run.cell, camera_late_s=CAMERA_LATE_S, camera_drift_ppm=CAMERA_DRIFT_PPM))


def pictures_in_motion(config: RunConfig, plan: Plan, progress: Progress) -> PicturesInMotion:
    """Move the arm through the poses of a plan without a pause, taking pictures; it ends at home.

    Raises `HardwareError` where the arm or the camera fails. Ctrl-C brakes the arm.
    """
    return virtual_time.run(_moving_in_cell(config, plan, progress))


def checked_poses(config: RunConfig, plan: Plan, progress: Progress, pause_s: float) -> CheckedPoses:
    """Plan poses for the present view of the camera, and check all motions with an arm in software.

    The arm rests for `pause_s` in each pose. Raises `HardwareError` where the camera fails.
    """
    return virtual_time.run(_check_in_cell(replace(config, dry_run=True), plan, progress, pause_s))


def pictures_of_held_board(config: RunConfig, plan: Plan, progress: Progress) -> list[BoardPicture]:
    """Move the arm through all poses of a plan and take a picture in each; the arm ends at home.

    Raises `HardwareError` where the arm or the camera fails. Ctrl-C brakes the arm.
    """
    return virtual_time.run(_in_cell(config, plan, progress))


def pictures_of_board_on_table(config: RunConfig, count: int, progress: Progress) -> list[BoardPicture]:
    """Take pictures of a board that lies on the table. Raises `HardwareError`."""
    return virtual_time.run(_in_cell(config, None, progress, count))


@asynccontextmanager
async def _cell_at_rest(config: RunConfig) -> AsyncGenerator[tuple[LockstepSystem, Camera]]:
    """The cell with a straight DLO in its own folder, and its camera; the arm is at rest."""
    start = builtin_shape("I", config.cell.dlo.length_m, 100)
    with tempfile.TemporaryDirectory() as folder:
        async with lockstep_system(config, start, Path(folder)) as system:
            system.transport.latest(topics.ROBOT_STATE)  # subscribes
            await system.clock.sleep(REST_S)
            yield system, config.camera.build(system.transport)


async def _in_cell(config: RunConfig, plan: Plan | None, progress: Progress, count: int = 1) -> list[BoardPicture]:
    async with _cell_at_rest(config) as (system, camera):
        if plan is None:
            return [await _picture(camera, progress, number, count) for number in range(1, count + 1)]
        poses = plan((await camera.capture(_CAPTURE_S)).calibration)
        taken: list[BoardPicture] = []
        for number, q_rad in enumerate(poses, start=1):
            await _done(system, robot.MOVE_JOINTS, q_rad)
            await system.clock.sleep(REST_S)
            picture = await _picture(camera, progress, number, len(poses))
            state = system.transport.latest(topics.ROBOT_STATE).value
            taken.append(replace(picture, robot=state))
        await _done(system, robot.HOME)
        return taken


async def _check_in_cell(config: RunConfig, plan: Plan, progress: Progress, pause_s: float) -> CheckedPoses:
    refused: list[str] = []
    async with _cell_at_rest(config) as (system, camera):
        poses = plan((await camera.capture(_CAPTURE_S)).calibration)
        began_ns = system.clock.now_ns()
        for number, q_rad in enumerate(poses, start=1):
            progress(number, len(poses))
            moved = await system.transport.call(robot.MOVE_JOINTS, q_rad)
            if not isinstance(moved, Succeeded):
                refused.append(f"pose {number}: {moved.why}")
            await system.clock.sleep(pause_s)
        await _done(system, robot.HOME)
        took_s = (system.clock.now_ns() - began_ns) / 1e9
        return CheckedPoses(poses=len(poses), refused=tuple(refused), duration_s=took_s)


async def _moving_in_cell(config: RunConfig, plan: Plan, progress: Progress) -> PicturesInMotion:
    images: list[CameraPictures] = []
    states: list[RobotState] = []
    async with _cell_at_rest(config) as (system, camera):
        poses = plan((await camera.capture(_CAPTURE_S)).calibration)
        await _done(system, robot.MOVE_JOINTS, poses[0])
        listening = asyncio.create_task(_collect(system, states))
        await system.clock.sleep(_BEFORE_MOTION_S)
        for number, q_rad in enumerate(poses[1:], start=1):
            progress(number, len(poses) - 1)
            moving = asyncio.create_task(_done(system, robot.MOVE_JOINTS, q_rad))
            try:
                while not moving.done():
                    images.append(await camera.capture(_CAPTURE_S))
                    await system.clock.sleep(_BETWEEN_PICTURES_S)
                await moving
            finally:
                moving.cancel()
        await system.clock.sleep(_BEFORE_MOTION_S)
        listening.cancel()
        await _done(system, robot.HOME)
    return PicturesInMotion(images=images, states=states)


async def _collect(system: LockstepSystem, states: list[RobotState]) -> None:
    async for state in system.transport.stream(topics.ROBOT_STATE):
        states.append(state)  # noqa: PERF401  the stream does not end


async def _picture(camera: Camera, progress: Progress, number: int, count: int) -> BoardPicture:
    progress(number, count)
    return BoardPicture(images=await camera.capture(_CAPTURE_S), robot=None)


async def _done(system: LockstepSystem, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    outcome = await system.transport.call(skill, *args, **kwargs)
    if isinstance(outcome, Succeeded):
        return outcome.result
    raise HardwareError(f"the arm did not do {skill.name}: {outcome.why}; the calibration has ended, call it again")


def without_optics(camera: CameraCalibration, date: str) -> CameraCalibration:
    """Size, serial and approximate focal length of a camera, as the start of its first calibration."""
    bare = centred_camera(camera.width_px, camera.height_px, camera.fx_px, geometry.pose((0.0, 0.0, 0.0)))
    return msgspec.structs.replace(
        bare, fy_px=camera.fy_px, serial=camera.serial, date=date, stamps_late_s=camera.stamps_late_s
    )
