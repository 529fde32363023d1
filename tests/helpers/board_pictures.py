"""Corners of a board as a camera would find them, computed without pictures."""

from collections.abc import Sequence
from functools import cache

import cv2
import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.description.default_cameras import default_calibration
from dlokit.extras.calibration.board_poses import HeldBoard, board_poses
from dlokit.extras.calibration.charuco import BoardView
from dlokit.extras.calibration.stereo_rig import BoardShot, ideal_pixels
from dlokit.functional.cell.lens import separate_cameras
from dlokit.geometry.camera import SIDES, Side, back_project, baseline_m, camera_alone, camera_matrix, in_camera
from dlokit.motion.forward_kinematics import tcp_pose
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


def separate_camera() -> CameraCalibration:
    """Two cameras that are not parallel."""
    return separate_cameras(default_calibration())


def view(corners_world: Float64Array, camera: CameraCalibration, side: Side, rng: np.random.Generator) -> BoardView:
    pixels = taken_pixels(corners_world, camera, side)
    return BoardView(numbers=np.arange(len(pixels)), pixels=pixels + rng.normal(0.0, NOISE_PX, pixels.shape))


def taken_pixels(points_world: Float64Array, camera: CameraCalibration, side: Side) -> Float64Array:
    """Where one camera of a pair shows points of the world, (N, 2) [px], in its picture as it is taken."""
    taken = camera_alone(camera, side)
    assert taken.distortion is not None
    K = camera_matrix(taken.fx_px, taken.fy_px, taken.cx_px, taken.cy_px)
    p = in_camera(points_world, taken)
    pixels = cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, taken.distortion.astype(np.float64))[0]
    return np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def seen_in_world(points_world: Float64Array, true: CameraCalibration, camera: CameraCalibration) -> Float64Array:
    """Where a calibrated pair sees points (N, 3) [m] of the world that the true pair takes pictures of."""
    numbers = np.arange(len(points_world))
    left, right = (
        ideal_pixels(BoardView(numbers=numbers, pixels=taken_pixels(points_world, true, side)), camera, side)
        for side in SIDES
    )
    return back_project(left, camera.fx_px * baseline_m(camera) / (left[:, 0] - right[:, 0]), camera)


def workspace_points() -> Float64Array:
    """Points (27, 3) [m] in the space in which a DLO is handled."""
    axes = ([0.35, 0.5, 0.65], [-0.25, 0.0, 0.25], [0.0, 0.1, 0.2])
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@cache
def angles(count: int, seed: int = 0) -> tuple[Float64Array, ...]:
    """Joint angles (J,) [rad] of poses that show the board; not to be changed."""
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
    arm: ArmModel = PANDA,
) -> list[BoardShot]:
    """What is seen while the arm reports these joint angles, which are off by `offsets_rad` (J,)."""
    rng = np.random.default_rng(seed)
    offsets = np.zeros(len(arm.joints)) if offsets_rad is None else offsets_rad
    shots: list[BoardShot] = []
    for q in reported_rad:
        T_world_board = geometry.compose(tcp_pose(arm, q - offsets), T_tcp_board)
        corners = geometry.transform(T_world_board, scale * BOARD.corners_board)
        left, right = (view(corners, camera, side, rng) for side in SIDES)
        shots.append(BoardShot(left=left, right=right, T_world_tcp=tcp_pose(arm, q), q_rad=q))
    return shots
