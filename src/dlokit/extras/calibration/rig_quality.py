"""The accuracy of a stereo pair's optics, in pixels and in millimetres, also in held-out pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit.description.board import CharucoBoard
from dlokit.extras.calibration.charuco import FEWEST_CORNERS
from dlokit.extras.calibration.stereo_rig import (
    BoardShot,
    RigFit,
    board_in_camera,
    calibrate_rig,
    ideal_pixels,
    split_held_out,
)
from dlokit.geometry.camera import baseline_m, camera_matrix, turn_to_rectified
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration

_LENS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class RigHeldOut:
    """Errors of a pair for boards in held-out pictures."""

    rows_px: Float64Array  # (K,) between the rows of a corner in both rectified pictures; matching needs below 0.5
    board_m: Float64Array  # (K,) distance of a corner in space, from both cameras, from its place on the board


def held_out_rig(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> RigHeldOut:
    """Fit four of five pictures, and compare the rest with the board. Raises `SkillFailure` as `calibrate_rig`."""
    others, kept = split_held_out(shots)
    found = calibrate_rig(others, board, camera).camera
    pairs = [_compared(shot, board, found) for shot in kept]
    return RigHeldOut(
        rows_px=np.concatenate([np.zeros(0), *(rows for rows, _ in pairs)]),
        board_m=np.concatenate([np.zeros(0), *(apart for _, apart in pairs)]),
    )


def corners_deviation_m(fit: RigFit, shots: Sequence[BoardShot], board: CharucoBoard) -> Float64Array:
    """Standard deviation (8,) [m] of points at the corners of the space that the boards cover.

    A common motion of all points does not count as an error: hand-eye calibration finds the camera's pose.
    """
    points = _corners_of_space(fit.camera, shots, board)
    at = points @ turn_to_rectified(fit.camera, 0)  # in the frame of the left camera alone
    pixels = _seen(at, fit.cameras)
    steps = np.sqrt(np.diag(fit.covariance))
    slopes = np.zeros((at.size, len(steps)))
    for index in np.nonzero(steps)[0]:
        changed = fit.cameras.copy()
        changed[index] += steps[index]
        slopes[:, index] = ((_triangulated(pixels, changed) - at) / steps[index]).ravel()
    centred = at - at.mean(axis=0)
    turns = np.stack([np.cross(axis, centred).ravel() for axis in np.eye(3)], axis=1)
    together = np.linalg.qr(np.column_stack([np.tile(np.eye(3), (len(at), 1)), turns]))[0]
    slopes -= together @ (together.T @ slopes)
    variances = np.einsum("ij,jk,ik->i", slopes, fit.covariance, slopes)
    return np.sqrt(np.maximum(variances, 0.0).reshape(-1, 3).sum(axis=1))


def _compared(shot: BoardShot, board: CharucoBoard, camera: CameraCalibration) -> tuple[Float64Array, Float64Array]:
    """Distances of rows (K,) [px], and of corners in space from the board (K,) [m]."""
    if shot.right is None:
        return np.zeros(0), np.zeros(0)
    common, in_left, in_right = np.intersect1d(shot.left.numbers, shot.right.numbers, return_indices=True)
    if len(common) < FEWEST_CORNERS:
        return np.zeros(0), np.zeros(0)
    left, right = ideal_pixels(shot.left, camera, 0)[in_left], ideal_pixels(shot.right, camera, 1)[in_right]
    depth_m = camera.fx_px * baseline_m(camera) / (left[:, 0] - right[:, 0])
    rays = (left - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    seen = np.column_stack([rays, np.ones(len(rays))]) * depth_m[:, None]
    corners = board.corners_board[common]
    seen, corners = seen - seen.mean(axis=0), corners - corners.mean(axis=0)
    turn = Rotation.align_vectors(seen, corners)[0]
    return np.abs(left[:, 1] - right[:, 1]), np.linalg.norm(seen - turn.apply(corners), axis=1)


def _corners_of_space(camera: CameraCalibration, shots: Sequence[BoardShot], board: CharucoBoard) -> Float64Array:
    """Corners (8, 3) [m], in the rectified frame, of the space between the nearest and the farthest board."""
    boards = [board_in_camera(shot.left, board.corners_board, camera) for shot in shots]
    depths_m = np.array([T.position_m[2] for T in boards if T is not None])
    pixels = np.concatenate([ideal_pixels(shot.left, camera, 0) for shot in shots])
    bounds = (pixels - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
    x, y, z = np.meshgrid(*((part.min(), part.max()) for part in (bounds[:, 0], bounds[:, 1], depths_m)), indexing="ij")
    return np.stack([x * z, y * z, z], axis=-1).reshape(-1, 3)


def _cameras(cameras: Float64Array) -> list[tuple[Float64Array, Float64Array, Float64Array, Float64Array]]:
    """Camera matrix, lens, and rotation vector and shift from the left camera's frame, of both cameras (22,)."""
    turns = (np.zeros(6), cameras[2 * _LENS :])
    return [
        (
            camera_matrix(*cameras[at : at + 4].tolist()),
            np.append(cameras[at + 4 : at + _LENS], 0.0),
            turn[:3],
            turn[3:],
        )
        for at, turn in zip((0, _LENS), turns, strict=True)
    ]


def _seen(points: Float64Array, cameras: Float64Array) -> list[Float64Array]:
    """The pixels (N, 2) of points (N, 3) [m] in both unrectified pictures."""
    return [
        np.asarray(cv2.projectPoints(points, turn, shift, K, lens)[0], dtype=np.float64).reshape(-1, 2)
        for K, lens, turn, shift in _cameras(cameras)
    ]


def _triangulated(pixels: Sequence[Float64Array], cameras: Float64Array) -> Float64Array:
    """The points (N, 3) [m] of pixels in both unrectified pictures, in the frame of the left camera."""
    rays: list[Float64Array] = []
    matrices: list[Float64Array] = []
    for seen, (K, lens, turn, shift) in zip(pixels, _cameras(cameras), strict=True):
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        ideal = cv2.undistortPoints(seen[:, None], K, lens, criteria=criteria)
        rays.append(np.asarray(ideal, dtype=np.float64).reshape(-1, 2))
        matrices.append(np.column_stack([np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64), shift]))
    found = np.asarray(cv2.triangulatePoints(matrices[0], matrices[1], rays[0].T, rays[1].T), dtype=np.float64)
    return (found[:3] / found[3]).T
