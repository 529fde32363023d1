import itertools

import msgspec
import numpy as np
import pytest
from board_pictures import BOARD, T_TCP_BOARD, angles
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.default_cameras import default_calibration
from dlokit.description.scene import Box
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.board_poses import HeldBoard, board_poses
from dlokit.geometry.camera import project
from dlokit.motion.collisions import check_collisions
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.forward_kinematics import tcp_matrices, tcp_pose
from dlokit.motion.trajectories import joint_move

CAMERA = default_calibration()


def test_the_board_is_in_view_clear_of_the_table_and_turned_to_all_sides():
    poses = angles(15)
    assert len(poses) == 15
    check_collisions(PANDA, np.array(poses))
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    for q in poses:
        outline = geometry.transform(geometry.compose(tcp_pose(PANDA, q), T_TCP_BOARD), BOARD.outline_board)
        assert outline[:, 2].min() > 0.03
        pixels = project(outline, CAMERA).pixels
        assert np.all((pixels > 0) & (pixels < size))
    R = tcp_matrices(PANDA, np.array(poses))[:, :3, :3]
    turns = Rotation.from_matrix(np.swapaxes(R[:1], 1, 2) @ R).as_rotvec()
    assert np.linalg.svd(turns - turns.mean(axis=0), compute_uv=False)[2] / np.sqrt(len(turns)) > np.radians(10)


def test_the_same_seed_gives_the_same_poses():
    assert np.array_equal(angles(3, seed=4), angles(3, seed=4))
    assert not np.array_equal(angles(3, seed=4), angles(3, seed=5))


def test_a_camera_that_sees_nothing_of_the_space_is_refused():
    looking_up = geometry.pose((0.5, 0.0, 1.0))

    camera = msgspec.structs.replace(CAMERA, T_world_camera=looking_up)
    with pytest.raises(SkillFailure, match="only 0 of 2 poses"):
        board_poses(HeldBoard(board=BOARD, T_tcp_board=T_TCP_BOARD), camera, 2, np.random.default_rng(0))


def test_neither_arm_nor_board_comes_near_a_fixture_on_the_way():
    tower = (Box(name="tower", position_m=(0.5, 0.0, 0.0), size_m=(0.08, 0.08, 0.3)),)
    poses = board_poses(
        HeldBoard(board=BOARD, T_tcp_board=T_TCP_BOARD, fixtures=tower), CAMERA, 4, np.random.default_rng(0)
    )
    blind = angles(4)
    assert not np.array_equal(poses, blind)
    for start, end in itertools.pairwise((PANDA.home_q_rad, *poses, PANDA.home_q_rad)):
        q_rad = joint_move(start, end, PANDA.limits).q_rad
        check_fixtures_clear(PANDA, q_rad, PANDA.gripper.open_width_m, tower, may_leave=False)
        for T in tcp_matrices(PANDA, q_rad) @ geometry.matrix(T_TCP_BOARD):
            corners = BOARD.outline_board @ T[:3, :3].T + T[:3, 3]
            grid = np.linspace(0.0, 1.0, 9)
            edge = corners[0] + grid[:, None] * (corners[1] - corners[0])
            face = (edge[:, None] + grid[:, None] * (corners[3] - corners[0])).reshape(-1, 3)
            outside = np.maximum(np.abs(face - (0.5, 0.0, 0.15)) - (0.04, 0.04, 0.15), 0.0)
            assert np.linalg.norm(outside, axis=1).min() > 0.03
