"""The camera's pose from the hand, in a random cell for each seed, compared with the true pose."""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.geometry.camera import project
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.trajectories import joint_move
from dlokit.skills.perception.calibration.hand_sight import HandLook, camera_from_hand, corrected_by
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.pipeline import corrected_camera_pose
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.pose import Pose

CONFIG = PerceptionConfig()
PLACES = ((0.50, 0.14, np.pi / 2), (0.50, -0.14, -np.pi / 2))


def table_error_m(T_world_camera: Pose, true: CameraCalibration) -> float:
    """Error of reconstructed points at the table's height, root mean square [m]."""
    x, y = np.meshgrid([0.3, 0.45, 0.6], [-0.25, 0.0, 0.25])
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(9)])
    pixels = project(places, true).pixels
    rays = np.column_stack([(pixels - [true.cx_px, true.cy_px]) / true.fx_px, np.ones(9)])
    rays = rays @ geometry.rotation(T_world_camera).T
    seen = T_world_camera.position_m - rays * (T_world_camera.position_m[2] / rays[:, 2])[:, None]
    return float(np.sqrt(np.mean(np.sum((seen - places) ** 2, axis=1))))


Expose = Callable[[Cell], CameraPictures]


def by_the_table(cell: Cell, expose: Expose) -> CameraPictures:
    images = expose(cell)
    pose = corrected_camera_pose(images, (PosedArm(PANDA, cell.arm_state()),), CONFIG, CONFIG.segmentation)
    assert pose is not None
    return msgspec.structs.replace(images, calibration=msgspec.structs.replace(images.calibration, T_world_camera=pose))


def hand_look(cell: Cell, expose: Expose, x_m: float, y_m: float, yaw_rad: float) -> HandLook:
    q = ArmKinematics(PANDA).inverse(geometry.downward([x_m, y_m, 0.15], yaw_rad))
    trajectory = joint_move(cell.arm_state().q_rad, q, PANDA.limits)
    cell.arm.start_follow(trajectory, cell.time_s)
    cell.step(round(float(trajectory.times_s[-1]) + 0.2, 1))
    return HandLook(images=expose(cell), robot=PosedArm(PANDA, cell.arm_state()))


@pytest.mark.parametrize(("seed", "shadows"), [(1000, False), (1001, True)])
def test_the_hand_reduces_the_camera_error_of_a_random_cell_below_a_millimetre(seed: int, shadows: bool):
    cell = Cell(CellConfig(randomised=EVERY_FACTOR, shadows=shadows), seed=seed)
    background = by_the_table(cell, Cell.capture)
    looks = [hand_look(cell, Cell.capture, *place) for place in PLACES]
    cell.close()
    believed, true = background.calibration.T_world_camera, cell.rig.true_calibration
    assert table_error_m(believed, true) > 0.005  # otherwise the test would show nothing
    check = camera_from_hand(background, looks)
    corrected = corrected_by(believed, check)
    # The rest is the table's tilt, known from the hand to 0.05 deg, and the pixel grid at the arm's edge.
    assert table_error_m(corrected, true) < 0.001
    turn = geometry.rotation(corrected) @ geometry.rotation(true.T_world_camera).T
    assert abs(np.degrees(turn[1, 0])) < 0.1


def test_the_single_view_of_a_depth_camera_suffices():
    cell = Cell(CellConfig(), seed=1000)
    background = by_the_table(cell, Cell.capture_depth)
    looks = [hand_look(cell, Cell.capture_depth, *place) for place in PLACES]
    cell.close()
    believed, true = background.calibration.T_world_camera, cell.depth_rig.true_calibration
    assert table_error_m(believed, true) > 0.002  # otherwise the test would show nothing
    corrected = corrected_by(believed, camera_from_hand(background, looks))
    # One view tells less of the height and the tilts than two, which the noise of the depth leaves open.
    assert table_error_m(corrected, true) < 0.0015
