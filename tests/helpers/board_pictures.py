"""Corners of a board as a camera would find them, computed without pictures."""

from collections.abc import Sequence

import cv2
import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.board import CharucoBoard
from dlokit.description.scene import default_calibration
from dlokit.geometry.camera import camera_matrix
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.skills.perception.calibration.board_poses import HeldBoard, board_poses
from dlokit.skills.perception.calibration.charuco import BoardView
from dlokit.skills.perception.calibration.stereo_rig import BoardShot
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

BOARD = CharucoBoard()
T_TCP_BOARD = geometry.pose((0.035, 0.14, -0.05), (0.5, 0.5, -0.5, -0.5))
"""The board faces along x of the tool."""
NOISE_PX = 0.05


def lens_camera() -> CameraCalibration:
    return msgspec.structs.replace(
        default_calibration(),
        distortion=np.array([0.06, -0.05, 0.0006, -0.0004, 0.0], dtype=np.float32),
        distortion_right=np.array([0.05, -0.04, -0.0005, 0.0007, 0.0], dtype=np.float32),
    )


def view(corners_world: Float64Array, camera: CameraCalibration, side: int, rng: np.random.Generator) -> BoardView:
    p = geometry.transform(geometry.inverse(camera.T_world_camera), corners_world)
    p[:, 0] -= side * (camera.baseline_m or 0.0)
    lens = (camera.distortion, camera.distortion_right)[side]
    assert lens is not None
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    pixels = cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, lens.astype(np.float64))[0]
    noise = rng.normal(0.0, NOISE_PX, (len(p), 2))
    return BoardView(numbers=np.arange(len(p)), pixels=np.asarray(pixels).reshape(-1, 2) + noise)


def angles(count: int, seed: int = 0) -> tuple[Float64Array, ...]:
    held = HeldBoard(board=BOARD, T_tcp_board=T_TCP_BOARD)
    return board_poses(held, default_calibration(), count, np.random.default_rng(seed))


def shots_of(
    reported_rad: Sequence[Float64Array],
    camera: CameraCalibration,
    *,
    T_tcp_board: Pose = T_TCP_BOARD,
    scale: float = 1.0,
    offsets_rad: Float64Array | None = None,
    seed: int = 0,
) -> list[BoardShot]:
    """What is seen while the arm reports these joint angles, which are off by `offsets_rad` (7,)."""
    rng = np.random.default_rng(seed)
    offsets = np.zeros(7) if offsets_rad is None else offsets_rad
    shots: list[BoardShot] = []
    for q in reported_rad:
        T_world_board = geometry.compose(tcp_pose(PANDA, q - offsets), T_tcp_board)
        corners = geometry.transform(T_world_board, scale * BOARD.corners_board)
        left, right = (view(corners, camera, side, rng) for side in (0, 1))
        shots.append(BoardShot(left=left, right=right, T_world_tcp=tcp_pose(PANDA, q), q_rad=q))
    return shots
