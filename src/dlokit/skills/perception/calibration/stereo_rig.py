"""The optics of a camera or a stereo pair from pictures of a ChArUco board: intrinsics, lenses, baseline.

Perception takes the two cameras of a pair to be parallel with common intrinsics, so this is the model that is fitted;
the distortion of each lens is its own. All pictures are fitted at once by the error of the corners in them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import msgspec
import numpy as np
import scipy
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.geometry.camera import camera_matrix
from dlokit.skills.perception.calibration.charuco import BoardView
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FEW_PICTURES, NOT_PARALLEL = "few_pictures", "not_parallel"
FEWEST_PICTURES = 8
"""Pictures that show the board, below which nothing is fitted."""
_OUTLIER_PX = 0.5
"""Errors of corners above this count less [px]; the corner search is good to 0.1 px."""
_LARGEST_RMS_PX = 1.0
"""Above this the model does not describe the rig."""
_OPTICS, _POSE = 13, 6
"""Unknowns of the rig (fx, fy, cx, cy; k1, k2, p1, p2 of each lens; baseline), and of each picture."""
_BASELINE = 12


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardShot:
    """One place of the board: where each camera sees its corners, and where the arm says it is."""

    left: BoardView
    right: BoardView | None = None
    """None: a single camera, or the right one does not show it."""
    T_world_tcp: Pose | None = None
    """Reported pose of the tool; None where the board is not in the arm's hand."""
    q_rad: Float64Array | None = None  # (J,) reported joint angles, where they are known


@dataclass(frozen=True, kw_only=True, eq=False)
class RigFit:
    """The calibrated rig, and how well it describes the pictures."""

    camera: CameraCalibration
    """With the pose, serial and date of the calibration that was given."""
    rms_px: float
    corners: int


def calibrate_rig(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> RigFit:
    """Intrinsics, lenses and baseline of the camera whose size, pose and names `camera` gives.

    Lengths are by the nominal size of the board. Raises `SkillFailure` few_pictures or not_parallel.
    """
    if len(shots) < FEWEST_PICTURES:
        raise SkillFailure(
            FEW_PICTURES,
            f"{len(shots)} pictures show the board, at least {FEWEST_PICTURES} are needed; take more, with the board "
            "tilted to all sides",
        )
    stereo = any(shot.right is not None for shot in shots)
    problem = _RigProblem(shots, board, stereo)
    start = _start(shots, board, camera, stereo)
    fit: Any = scipy.optimize.least_squares(
        problem.errors_px, start, jac=problem.jacobian, loss="soft_l1", f_scale=_OUTLIER_PX, x_scale="jac"
    )
    errors = problem.errors_px(fit.x).reshape(-1, 2)
    rms_px = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
    if rms_px > _LARGEST_RMS_PX:
        raise SkillFailure(
            NOT_PARALLEL,
            f"the corners are {rms_px:.2f} px off after the fit, at most {_LARGEST_RMS_PX:g} px are accepted; are the "
            "squares of the board as large as given, and the two cameras parallel? A pair that is not must be "
            "rectified by its driver",
        )
    return RigFit(camera=_calibration(fit.x, camera, stereo), rms_px=rms_px, corners=len(errors))


def ideal_pixels(view: BoardView, camera: CameraCalibration, lens: Float32Array | None) -> Float64Array:
    """The corners (N, 2) [px] as a camera without distortion would show them."""
    if lens is None:
        return view.pixels
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    ideal = cv2.undistortPoints(view.pixels[:, None], K, lens.astype(np.float64), P=K, criteria=criteria)
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)


def board_in_camera(view: BoardView, corners_board: Float64Array, camera: CameraCalibration) -> Pose | None:
    """``T_camera_board`` by one picture of the left camera; None where the corners do not give one."""
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    pixels = ideal_pixels(view, camera, camera.distortion)
    found, turn, shift = cv2.solvePnP(corners_board[view.numbers], pixels, K, np.zeros(5), flags=cv2.SOLVEPNP_ITERATIVE)
    if not found or float(shift[2, 0]) <= 0.0:
        return None
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    return geometry.pose_from_matrix(T)


class _RigProblem:
    """The errors of all corners, and how they change with the unknowns: the optics, then a pose per picture."""

    def __init__(self, shots: Sequence[BoardShot], board: CharucoBoard, stereo: bool) -> None:
        corners = board.corners_board
        self._parts = [
            (index, side, corners[view.numbers], view.pixels)
            for index, shot in enumerate(shots)
            for side, view in enumerate((shot.left, shot.right if stereo else None))
            if view is not None
        ]
        self._unknowns = _OPTICS + _POSE * len(shots)

    def errors_px(self, x: Float64Array) -> Float64Array:
        return np.concatenate([(self._projected(part, x)[0] - part[3]).ravel() for part in self._parts])

    def jacobian(self, x: Float64Array) -> Float64Array:
        blocks: list[Float64Array] = []
        for part in self._parts:
            index, side = part[0], part[1]
            slopes = self._projected(part, x)[1]
            block = np.zeros((len(slopes), self._unknowns))
            at = _OPTICS + _POSE * index
            block[:, at : at + _POSE] = slopes[:, :_POSE]
            block[:, :4] = slopes[:, 6:10]
            block[:, 4 + 4 * side : 8 + 4 * side] = slopes[:, 10:14]
            if side == 1:
                block[:, _BASELINE] = -slopes[:, 3]  # the right camera sees everything moved to its left
            blocks.append(block)
        return np.concatenate(blocks)

    def _projected(
        self, part: tuple[int, int, Float64Array, Float64Array], x: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Pixels (N, 2), and their slopes (2 N, …) by rotation, translation, focal lengths, centre and lens."""
        index, side, corners, _ = part
        at = _OPTICS + _POSE * index
        shift = x[at + 3 : at + 6] - np.array([side * x[_BASELINE], 0.0, 0.0])
        lens = np.append(x[4 + 4 * side : 8 + 4 * side], 0.0)
        pixels, slopes = cv2.projectPoints(corners, x[at : at + 3], shift, camera_matrix(*x[:4].tolist()), lens)[:2]
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.asarray(slopes, dtype=np.float64)


def _start(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, stereo: bool
) -> NDArray[np.float64]:
    """The unknowns by OpenCV's calibration of the left camera alone."""
    corners = board.corners_board
    points = [corners[shot.left.numbers].astype(np.float32) for shot in shots]
    pixels = [shot.left.pixels.astype(np.float32) for shot in shots]
    size = (camera.width_px, camera.height_px)
    guess = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS + cv2.CALIB_FIX_K3
    _, K, lens, turns, shifts = cv2.calibrateCamera(points, pixels, size, guess, np.zeros(5), flags=flags)
    x = np.zeros(_OPTICS + _POSE * len(shots))
    x[:4] = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    x[4:8] = np.ravel(lens)[:4]
    x[_OPTICS:] = np.concatenate([np.ravel(part) for pair in zip(turns, shifts, strict=True) for part in pair])
    if stereo:
        x[_BASELINE] = camera.baseline_m or _baseline_start(shots, corners, x)
    return x


def _baseline_start(shots: Sequence[BoardShot], corners: Float64Array, x: Float64Array) -> float:
    """By the disparity of the corners: ``B = d Z / f`` [m]."""
    found: list[float] = []
    for index, shot in enumerate(shots):
        if shot.right is None:
            continue
        common, left, right = np.intersect1d(shot.left.numbers, shot.right.numbers, return_indices=True)
        at = _OPTICS + _POSE * index
        depth_m = (corners[common] @ cv2.Rodrigues(x[at : at + 3])[0].T + x[at + 3 : at + 6])[:, 2]
        disparity_px = shot.left.pixels[left, 0] - shot.right.pixels[right, 0]
        found += (disparity_px * depth_m / x[0]).tolist()
    return float(np.median(found))


def _calibration(x: NDArray[np.float64], camera: CameraCalibration, stereo: bool) -> CameraCalibration:
    fx, fy, cx, cy = x[:4].tolist()
    lenses = [np.append(x[at : at + 4], 0.0).astype(np.float32) for at in (4, 8)]
    return msgspec.structs.replace(
        camera,
        fx_px=fx,
        fy_px=fy,
        cx_px=cx,
        cy_px=cy,
        baseline_m=float(x[_BASELINE]) if stereo else None,
        distortion=lenses[0],
        distortion_right=lenses[1] if stereo else None,
    )
