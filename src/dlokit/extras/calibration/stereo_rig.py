"""The optics of a camera or a stereo pair from pictures of a ChArUco board: intrinsics, lenses, relative pose.

Two models of a pair are fitted: two different cameras in any relative pose; and a parallel pair with common
intrinsics and different lenses, as of a stereo camera. The simpler model is chosen if it describes the pictures
equally well. One fit minimises the errors of the corners in all pictures, including corners and pictures of one camera
only.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import msgspec
import numpy as np
import scipy
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.description.board import CharucoBoard
from dlokit.errors import BadValue, SkillFailure
from dlokit.extras.calibration.charuco import BoardView
from dlokit.geometry.camera import SeparateCamera, Side, camera_alone, camera_matrix, rectified_pair, turn_to_rectified
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FEW_PICTURES, NO_RIG = "few_pictures", "no_rig"
HELD_OUT_EVERY = 5
"""Every n-th picture is held out of a second fit, and then compared with that fit."""
FEWEST_PICTURES = 8
"""Least number of pictures of the board for a fit."""
_OUTLIER_PX = 0.5
"""Errors of corners above this count less [px]; the corner search is good to 0.1 px."""
_LARGEST_RMS_PX = 1.0
"""Error above which the model does not describe the rig [px]."""
_LARGEST_SIGMA = 0.01
"""Largest standard deviation of focal lengths and centres over the focal length: 1 % are 10 mm in a
depth of 1 m. Tilted boards give 0.1 %, boards that all face the camera 10 %."""
_WORSE = 1.1
"""A parallel pair is chosen if its sum of squared errors is at most this multiple of two separate cameras' sum: 0.03 px
between rows for corners with errors of 0.1 px, and more than the effect of nine fewer unknowns on the noise in ten
pictures."""
_POSE = 6
"""Unknowns of each picture: the board's rotation vector and place in the frame of the left camera."""
_LENS = 8
"""Unknowns of each camera: fx, fy, cx, cy; k1, k2, p1, p2."""
_RIGHT = 2 * _LENS
"""Index, after both cameras, of the rotation vector and the shift from the left camera's frame to the right one's."""
_OPTICS = _RIGHT + 6


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardShot:
    """One pose of the board: its corners in each camera, and the reported pose of the arm."""

    left: BoardView
    right: BoardView | None = None
    """None: a single camera, or the right camera does not show the board."""
    T_world_tcp: Pose | None = None
    """Reported pose of the tool; None if the board is not in the arm's hand."""
    q_rad: Float64Array | None = None  # (J,) reported joint angles, where they are known


@dataclass(frozen=True, kw_only=True, eq=False)
class RigFit:
    """The calibrated rig, with its errors in the pictures."""

    camera: CameraCalibration
    """The camera with the pose, serial and date of the given calibration."""
    rms_px: float
    corners: int
    cameras: Float64Array  # (22,) both cameras [px] and the pose of one to the other, as `PAIR` names them
    covariance: Float64Array  # (22, 22) of these

    @property
    def parallel(self) -> bool:
        """Whether the pictures are from a parallel pair, or from a single camera."""
        return self.camera.raw_left is None


def calibrate_rig(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> RigFit:
    """Intrinsics, lenses and baseline of a camera; `camera` gives its size, pose and names.

    A pair that is not parallel gets `raw_left` and `raw_right`, which define the rectification. Lengths refer to the
    nominal size of the board. Raises `SkillFailure` few_pictures or no_rig.
    """
    if len(shots) < FEWEST_PICTURES:
        raise SkillFailure(
            FEW_PICTURES,
            f"{len(shots)} pictures show the board, at least {FEWEST_PICTURES} are needed; take more, with the board "
            "tilted to all sides",
        )
    both = sum(shot.right is not None for shot in shots)
    if 0 < both < FEWEST_PICTURES:
        raise SkillFailure(
            FEW_PICTURES,
            f"{both} pictures show the board to both cameras, at least {FEWEST_PICTURES} are needed; show the board "
            "where both see it",
        )
    fit = (
        _fit_pair(shots, board, camera)
        if both
        else _fit(_RigProblem(shots, board, _SINGLE), _start(shots, board, camera))
    )
    errors = fit.problem.errors_px(fit.x).reshape(-1, 2)
    rms = rms_px(errors)
    if rms > _LARGEST_RMS_PX:
        raise SkillFailure(
            NO_RIG,
            f"the corners are {rms:.2f} px off after the fit, at most {_LARGEST_RMS_PX:g} px are accepted; is the "
            "board flat, are its squares as large as given, did it stand still, and do the pictures of one NAME show "
            "the same moment?",
        )
    return RigFit(
        covariance=_determined(fit, rms),  # before the camera, because it may raise
        camera=_calibration(fit, camera),
        rms_px=rms,
        corners=len(errors),
        cameras=fit.cameras,
    )


def split_held_out(shots: Sequence[BoardShot]) -> tuple[list[BoardShot], list[BoardShot]]:
    """The pictures of the second fit, and the held-out ones."""
    others = [shot for number, shot in enumerate(shots, 1) if number % HELD_OUT_EVERY]
    return others, list(shots[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY])


def rms_px(errors_px: Float64Array) -> float:
    """Root mean square [px] of the lengths of errors (N, 2) [px]."""
    return float(np.sqrt(np.mean(np.sum(errors_px**2, axis=1))))


def _determined(fit: "_Fit", rms_px: float) -> Float64Array:
    """The covariance (22, 22) of the cameras. Raises `SkillFailure` no_rig if the pictures do not determine them."""
    sigma, covariance = np.inf, np.zeros((_OPTICS, _OPTICS))
    with suppress(np.linalg.LinAlgError):
        covariance = fit.covariance(rms_px)
        sigma = np.sqrt(np.diag(covariance)[:_RIGHT].reshape(2, _LENS)[:, :4].max()) / abs(fit.cameras[0])
    if not sigma <= _LARGEST_SIGMA:  # NaN is not
        raise SkillFailure(
            NO_RIG,
            f"focal lengths and centres are uncertain by {sigma:.1%} of the focal length, {_LARGEST_SIGMA:.0%} is "
            "accepted; take pictures with the board tilted to all sides, near and far",
        )
    return covariance


def ideal_pixels(view: BoardView, camera: CameraCalibration, side: Side) -> Float64Array:
    """The corners (N, 2) [px] in the rectified picture of a parallel camera without distortion."""
    taken = camera_alone(camera, side)
    if taken.distortion is None:
        return view.pixels
    ideal = cv2.undistortPoints(
        view.pixels[:, None],
        _matrix(taken),
        taken.distortion.astype(np.float64),
        R=turn_to_rectified(camera, side),
        P=_matrix(camera),
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9),
    )
    return np.asarray(ideal, dtype=np.float64).reshape(-1, 2)


def board_in_camera(view: BoardView, corners_board: Float64Array, camera: CameraCalibration) -> Pose | None:
    """``T_camera_board`` from one picture of the left camera; None if the corners do not determine it."""
    pixels = ideal_pixels(view, camera, 0)
    found, turn, shift = cv2.solvePnP(
        corners_board[view.numbers], pixels, _matrix(camera), np.zeros(5), flags=cv2.SOLVEPNP_ITERATIVE
    )
    if not found or float(shift[2, 0]) <= 0.0:
        return None
    return geometry.pose_from_matrix(geometry.homogeneous(cv2.Rodrigues(turn)[0], shift[:, 0]))


def _matrix(camera: CameraCalibration) -> Float64Array:
    return camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)


def _parallel() -> Float64Array:
    """(22, 13): the cameras of a pair by fx, fy, cx, cy; k1, k2, p1, p2 of the left and of the right lens; baseline."""
    expand = np.zeros((_OPTICS, 13))
    expand[:4, :4] = expand[_LENS : _LENS + 4, :4] = np.eye(4)
    expand[4:8, 4:8] = expand[_LENS + 4 : _RIGHT, 8:12] = np.eye(4)
    expand[_RIGHT + 3, 12] = -1.0  # the right camera sees everything shifted to the left
    return expand


_SEPARATE: Float64Array = np.eye(_OPTICS)
_PARALLEL: Float64Array = _parallel()
_SINGLE: Float64Array = np.eye(_OPTICS)[:, :_LENS]
"""Models: both cameras of a pair and their relative pose (22,), from the unknowns of the optics (K,)."""


class _RigProblem:
    """The errors of all corners and their derivatives by the unknowns: the optics, then a pose per picture."""

    def __init__(self, shots: Sequence[BoardShot], board: CharucoBoard, model: Float64Array) -> None:
        corners = board.corners_board
        self.model = model
        self._parts = [
            (index, side, corners[view.numbers], view.pixels)
            for index, shot in enumerate(shots)
            for side, view in enumerate((shot.left, None if model is _SINGLE else shot.right))
            if view is not None
        ]
        self._unknowns = model.shape[1] + _POSE * len(shots)

    def errors_px(self, x: Float64Array) -> Float64Array:
        return np.concatenate([(self._projected(part, x)[0] - part[3]).ravel() for part in self._parts])

    def jacobian(self, x: Float64Array) -> Float64Array:
        optics = self.model.shape[1]
        blocks: list[Float64Array] = []
        for part in self._parts:
            _, by_optics, by_pose = self._projected(part, x)
            block = np.zeros((len(by_pose), self._unknowns))
            block[:, :optics] = by_optics @ self.model
            at = optics + _POSE * part[0]
            block[:, at : at + _POSE] = by_pose
            blocks.append(block)
        return np.concatenate(blocks)

    def _projected(
        self, part: tuple[int, int, Float64Array, Float64Array], x: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Pixels (N, 2), and their derivatives by the optics (2 N, 22) and by the pose of the board (2 N, 6)."""
        index, side, corners, _ = part
        optics = self.model.shape[1]
        cameras = self.model @ x[:optics]
        pose = x[optics + _POSE * index : optics + _POSE * (index + 1)]
        turn, shift = pose[:3], pose[3:]
        by_pose, by_right = np.eye(_POSE), np.zeros((_POSE, _POSE))
        if side == 1:
            moved = cv2.composeRT(turn, shift, cameras[_RIGHT : _RIGHT + 3], cameras[_RIGHT + 3 :])
            turn, shift, *slopes = (np.asarray(one, dtype=np.float64) for one in moved)
            # Of the turn and of the shift, by the board's turn and shift and by those to the right camera.
            by_pose = np.block([slopes[0:2], slopes[4:6]])
            by_right = np.block([slopes[2:4], slopes[6:8]])
        at = _LENS * side
        K, lens = camera_matrix(*cameras[at : at + 4].tolist()), np.append(cameras[at + 4 : at + _LENS], 0.0)
        pixels, slopes = cv2.projectPoints(corners, turn, shift, K, lens)[:2]
        jacobian = np.asarray(slopes, dtype=np.float64)
        by_optics = np.zeros((len(jacobian), _OPTICS))
        by_optics[:, at : at + _LENS] = jacobian[:, _POSE : _POSE + _LENS]
        by_optics[:, _RIGHT:] = jacobian[:, :_POSE] @ by_right
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), by_optics, jacobian[:, :_POSE] @ by_pose


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """The solution of a problem."""

    problem: _RigProblem
    x: NDArray[np.float64]
    cost: float
    jacobian: NDArray[np.float64]  # weighted by the robust loss

    @property
    def cameras(self) -> Float64Array:
        model = self.problem.model
        return model @ self.x[: model.shape[1]]

    def covariance(self, rms_px: float) -> Float64Array:
        """Covariance (22, 22) of the cameras for coordinates of corners with the root mean square error."""
        model = self.problem.model
        optics = model.shape[1]
        by_coordinate_px2 = rms_px**2 / 2.0
        unknowns = by_coordinate_px2 * np.linalg.inv(self.jacobian.T @ self.jacobian)[:optics, :optics]
        return model @ unknowns @ model.T


def _fit(problem: _RigProblem, start: NDArray[np.float64]) -> _Fit:
    found: Any = scipy.optimize.least_squares(
        problem.errors_px, start, jac=problem.jacobian, loss="soft_l1", f_scale=_OUTLIER_PX, x_scale="jac"
    )
    return _Fit(problem=problem, x=found.x, cost=float(found.cost), jacobian=found.jac)


def _fit_pair(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> _Fit:
    """Two separate cameras, or a parallel pair if it describes the pictures equally well."""
    left = _start(shots, board, camera)
    seen = [shot.right for shot in shots if shot.right is not None]
    right = _start([BoardShot(left=view) for view in seen], board, camera)
    poses = left[_LENS:].reshape(-1, _POSE)
    beside: list[Float64Array] = [
        _between(pose, there)
        for pose, there in zip(
            (pose for pose, shot in zip(poses, shots, strict=True) if shot.right is not None),
            right[_LENS:].reshape(-1, _POSE),
            strict=True,
        )
    ]
    middle = np.asarray(np.median(beside, axis=0), dtype=np.float64)
    start = np.asarray(np.concatenate([left[:_LENS], right[:_LENS], middle, left[_LENS:]]), dtype=np.float64)
    separate = _fit(_RigProblem(shots, board, _SEPARATE), start)
    common = np.linalg.lstsq(_PARALLEL, separate.cameras, rcond=None)[0]
    start = np.asarray(np.concatenate([common, separate.x[_OPTICS:]]), dtype=np.float64)
    parallel = _fit(_RigProblem(shots, board, _PARALLEL), start)
    return parallel if parallel.cost <= _WORSE * separate.cost else separate


def _start(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> NDArray[np.float64]:
    """The unknowns of the left camera alone (8 + 6 N,), by OpenCV's calibration."""
    corners = board.corners_board
    points = [corners[shot.left.numbers].astype(np.float32) for shot in shots]
    pixels = [shot.left.pixels.astype(np.float32) for shot in shots]
    size = (camera.width_px, camera.height_px)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS + cv2.CALIB_FIX_K3
    _, K, lens, turns, shifts = cv2.calibrateCamera(points, pixels, size, _matrix(camera), np.zeros(5), flags=flags)
    poses = [np.asarray(part, dtype=np.float64).ravel() for pair in zip(turns, shifts, strict=True) for part in pair]
    intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], dtype=np.float64)
    return np.concatenate([intrinsics, np.asarray(lens, dtype=np.float64).ravel()[:4], *poses])


def _between(left: Float64Array, right: Float64Array) -> Float64Array:
    """Rotation vector and shift (6,) from the left camera's frame to the right one's, by a board in both (6,)."""
    R_left, R_right = (np.asarray(cv2.Rodrigues(pose[:3])[0], dtype=np.float64) for pose in (left, right))
    R = R_right @ R_left.T
    turn = np.asarray(cv2.Rodrigues(R)[0], dtype=np.float64).ravel()
    return np.concatenate([turn, right[3:] - R @ left[3:]])


def _calibration(fit: _Fit, camera: CameraCalibration) -> CameraCalibration:
    """The fitted camera. Raises `SkillFailure` no_rig if the right camera is not on the right."""
    bare = msgspec.structs.replace(camera, distortion=None, distortion_right=None, raw_left=None, raw_right=None)
    left, right = (
        SeparateCamera(
            K=camera_matrix(*fit.cameras[at : at + 4].tolist()),
            distortion=np.append(fit.cameras[at + 4 : at + _LENS], 0.0).astype(np.float32),
        )
        for at in (0, _LENS)
    )
    if fit.problem.model is _SEPARATE or fit.cameras[_RIGHT + 3] > 0.0:
        turn = cv2.Rodrigues(fit.cameras[_RIGHT : _RIGHT + 3])[0]
        T_right_left = geometry.homogeneous(turn, fit.cameras[_RIGHT + 3 :])
        try:
            return rectified_pair(bare, left, right, T_right_left)
        except BadValue as error:
            raise SkillFailure(NO_RIG, str(error)) from error
    single = fit.problem.model is _SINGLE
    return msgspec.structs.replace(
        bare,
        fx_px=float(left.K[0, 0]),
        fy_px=float(left.K[1, 1]),
        cx_px=float(left.K[0, 2]),
        cy_px=float(left.K[1, 2]),
        baseline_m=None if single else float(-fit.cameras[_RIGHT + 3]),
        distortion=left.distortion,
        distortion_right=None if single else right.distortion,
    )
