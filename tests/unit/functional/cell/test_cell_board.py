from dataclasses import replace

import cv2
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape
from dlokit.extras.calibration.charuco import find_board
from dlokit.functional.cell.board import BOARD, T_WORLD_BOARD, draw_board
from dlokit.functional.cell.config import CellBoard, CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.geometry.camera import camera_matrix
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array
from dlokit.types.image import StereoImages
from dlokit.types.pose import Pose

SHOWING_Q_RAD = np.array([1.458, -1.389, -1.447, -2.237, -0.582, 2.014, -0.386])
WITH_BOARD = CellConfig(board=CellBoard(), lens_distortion=True, image_noise_sigma=0.0)


def errors_px(cell: Cell, images: StereoImages, T_world_board: Pose, side: int) -> Float64Array:
    """Corners found minus where the truth has them, in the left (0) or right (1) picture."""
    found = find_board((images.left, images.right)[side], BOARD)
    assert found is not None
    assert cell.board is not None
    camera = cell.rig.true_calibration
    corners = geometry.transform(T_world_board, cell.board.scale * BOARD.corners_board[found.numbers])
    p = geometry.transform(geometry.inverse(camera.T_world_camera), corners)
    p[:, 0] -= side * (camera.baseline_m or 0.0)
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    lens = (camera.distortion, camera.distortion_right)[side]
    assert lens is not None
    expected = cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, lens.astype(np.float64))[0]
    return found.pixels - np.asarray(expected, dtype=np.float64).reshape(-1, 2)


@pytest.fixture(scope="module")
def shown():
    """A cell whose arm has moved the board before the cameras."""
    cell = Cell(WITH_BOARD, seed=1)
    cell.arm.start_follow(joint_move(cell.arm.q_rad, SHOWING_Q_RAD, PANDA.limits), cell.time_s)
    cell.step(4.0)
    yield cell
    cell.close()


@pytest.mark.parametrize("side", [0, 1])
def test_both_cameras_show_the_held_board_where_it_is(shown: Cell, side: int):
    assert shown.board is not None
    assert shown.board.T_tcp_board is not None
    place = geometry.compose(shown.arm.T_world_tcp, shown.board.T_tcp_board)
    errors = errors_px(shown, shown.capture(), place, side)
    assert len(errors) == len(BOARD.corners_board)
    assert np.abs(errors.mean(axis=0)).max() < 0.1  # of the search for corners in rendered pictures
    assert errors.std(axis=0).max() < 0.2


def test_the_board_lies_on_the_table():
    cell = Cell(replace(WITH_BOARD, board=CellBoard(held=False)), seed=1)
    errors = errors_px(cell, cell.capture(), T_WORLD_BOARD, 0)
    assert np.abs(errors.mean(axis=0)).max() < 0.1
    cell.close()


def test_the_reported_state_is_off_by_a_tenth_of_a_degree_per_joint(shown: Cell):
    state = shown.arm_state()
    np.testing.assert_allclose(state.q_rad, SHOWING_Q_RAD, atol=2e-3)  # at rest where it was sent
    assert shown.board is not None
    assert np.degrees(np.abs(shown.board.joint_offsets_rad)) == pytest.approx([0.1] * 7)
    by_state = tcp_pose(PANDA, state.q_rad)
    np.testing.assert_allclose(state.T_world_tcp.position_m, by_state.position_m, atol=1e-12)
    true = tcp_pose(PANDA, state.q_rad - shown.board.joint_offsets_rad)
    np.testing.assert_allclose(shown.arm.T_world_tcp.position_m, true.position_m, atol=1e-4)
    assert np.linalg.norm(true.position_m - by_state.position_m) > 5e-4


def test_each_seed_draws_its_own_errors_and_the_print_is_larger_than_meant():
    first, again, other = (draw_board(CellBoard(), seed, PANDA) for seed in (0, 0, 1))
    assert np.array_equal(first.joint_offsets_rad, again.joint_offsets_rad)
    assert not np.array_equal(first.joint_offsets_rad, other.joint_offsets_rad)
    assert first.scale == 1.002
    assert draw_board(CellBoard(held=False), 0, PANDA).T_tcp_board is None


def test_a_camera_with_lenses_is_another_camera():
    plain, lenses = (Cell(CellConfig(lens_distortion=lens), seed=0) for lens in (False, True))
    assert plain.rig.calibration.serial == "simulated"
    assert lenses.rig.calibration.serial == "simulated-lens"
    assert plain.rig.calibration.distortion is None
    for cell in (plain, lenses):
        cell.place_dlo(builtin_shape("I", 0.5, 200), settle=False)
    before, after = plain.capture().left, lenses.capture().left
    assert np.abs(before.astype(float) - after).mean() > 2.0
    for cell in (plain, lenses):
        cell.close()
