"""The pose of a fixed camera in the world, from pictures of a board in the hand of an arm (eye to hand).

One robust least squares over all pictures fits the corners in them, left and right. Unknown are

- the pose of the camera in the world, ``T_world_camera``, and of the board in the tool, ``T_tcp_board``;
- the scales of the print and of the baseline, which may have been measured with the same print;
- the offset of each joint's reported angle, if angles are known, with a prior: the first joint's offset turns the
whole world and the last joint's offset turns the board, so that pictures cannot show these two. Any arm can be
used: a comparison with its kinematics finds the frames of its reported poses.

It starts from the published closed solution with the smallest error in the pictures (`hand_eye_start`).
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.hand_eye_start import METHODS, HandEyePoses, shah, skew
from dlokit.extras.calibration.stereo_rig import (
    FEW_PICTURES,
    FEWEST_PICTURES,
    BoardShot,
    board_in_camera,
    ideal_pixels,
    rms_px,
)
from dlokit.geometry.camera import SIDES, baseline_m
from dlokit.motion.forward_kinematics import tcp_matrices
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

ONE_AXIS, OTHER_ARM = "one_axis", "other_arm"
_NOISE_PX = 0.2
"""Standard deviation of a corner in a picture [px]; larger than the scatter, because neighbours' errors correlate."""
_OUTLIER = 3.0
"""Number of standard deviations above which errors count less."""
JOINT_SIGMA_RAD = float(np.radians(0.1))
"""Standard deviation of a joint's offset before the fit [rad]: the accuracy of an arm without a calibration."""
_SCALE_SIGMA = 0.005
"""Standard deviation of the scales of print and baseline before the fit."""
_OMITTED_ABOVE = 4.0
"""A picture with corner errors above this multiple of the median picture's is omitted from a second fit."""
_LEAST_TURN_RAD = 0.35
"""Least turn of the board about two axes that determines the poses [rad]."""
_SEEN = 0.5
"""Largest uncertainty of an observable joint offset after the fit, as a fraction of `JOINT_SIGMA_RAD`."""
_OTHER_ARM_M = 0.005
"""Reported poses farther than this from the kinematics of the arm belong to another arm [m]."""
LARGEST_APART_M, LARGEST_APART_RAD = 0.020, float(np.radians(2.0))
"""Camera and arm farther apart than this contradict each other. Three standard deviations of seven joint errors of 0.1°
are 0.8°, or 12 mm at a reach of 0.85 m; one picture of a small, distant board gives its place to 5 mm and its turn to
1°. Mistakes put them 100 mm or more apart."""
_UNFITTABLE_M = 0.100
"""Disagreement in the median picture above which no robust fit finds the correct poses."""
_UNITS = {1.0: "", 0.001: "positions in millimetres", 0.01: "positions in centimetres"}
ACCEPTED = (
    f"{LARGEST_APART_M * 1e3:.0f} mm and {np.degrees(LARGEST_APART_RAD):.0f}° are accepted, for a quarter of the "
    "pictures more. Look for lines whose pose is not that of the picture, or not in metres and w, x, y, z"
)
_CAMERA, _BOARD, _SCALES, _JOINTS = slice(0, 6), slice(6, 12), slice(12, 14), slice(14, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportedArm:
    """An arm, with the frames of its reported poses: ``T_world_base · kinematics · T_tcp_reported``."""

    arm: ArmModel
    T_world_base: Float64Array  # (4, 4)
    T_tcp_reported: Float64Array  # (4, 4)

    def poses(self, q_rad: Float64Array) -> Float64Array:
        """The poses (N, 4, 4) that are reported at angles (N, J) [rad]."""
        return self.T_world_base @ tcp_matrices(self.arm, q_rad) @ self.T_tcp_reported


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEyeFit:
    """The result of a hand-eye calibration."""

    camera: CameraCalibration
    """The camera with the fitted pose and baseline."""
    T_tcp_board: Pose
    print_scale: float
    """Size of the print over its nominal size."""
    reported: ReportedArm | None
    """Frames of the reported poses; None without known joint angles, as are then the next two fields."""
    joint_offsets_rad: Float64Array | None  # (J,) reported minus true
    joint_sigma_rad: Float64Array | None  # (J,) standard deviation of each
    rms_px: float
    """Error of the corners in the pictures, root mean square [px]."""
    rms_by_method_px: Mapping[str, float]
    """The same error of each closed solution [px]."""
    shots: Sequence[BoardShot]
    """The pictures of the fit."""
    rms_by_shot_px: Float64Array  # (N,) of each of them
    covariance: Float64Array  # (6, 6) of the camera's turn [rad] and shift [m], in the camera's frame

    @property
    def seen_joints(self) -> tuple[int, ...]:
        """Indices of the joints whose offset the pictures determine."""
        if self.joint_sigma_rad is None:
            return ()
        return tuple(np.flatnonzero(self.joint_sigma_rad < _SEEN * JOINT_SIGMA_RAD).tolist())

    def deviation_m(self, points_world: Float64Array) -> Float64Array:
        """Standard deviation (N,) [m] of the positions of points (N, 3) of the world, from the camera's pose."""
        p_camera = geometry.transform(geometry.inverse(self.camera.T_world_camera), points_world)
        slopes = np.concatenate([-skew(p_camera), np.broadcast_to(np.eye(3), (len(p_camera), 3, 3))], axis=2)
        return np.sqrt(np.einsum("nij,jk,nik->n", slopes, self.covariance, slopes))


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """Differences between the board's poses by camera and by arm, at held-out poses."""

    position_m: Float64Array  # (K,) of the board's centre, with the joint offsets corrected
    angle_rad: Float64Array  # (K,)
    reported_m: Float64Array  # (K,) by the arm's reported poses, which a run uses

    @property
    def worst(self) -> tuple[float, float, float]:
        """The 95th percentile of each."""
        position_m, angle_rad, reported_m = np.percentile((self.position_m, self.angle_rad, self.reported_m), 95.0, 1)
        return float(position_m), float(angle_rad), float(reported_m)

    @property
    def agree(self) -> bool:
        """Whether camera and arm contradict each other."""
        return self.worst[0] <= LARGEST_APART_M and self.worst[1] <= LARGEST_APART_RAD

    def __str__(self) -> str:
        return f"{self.worst[0] * 1e3:.1f} mm and {np.degrees(self.worst[1]):.1f}°"


def disagree(apart: HeldOut, why: str) -> SkillFailure:
    """The failure of camera and arm that contradict each other."""
    return SkillFailure("disagree", f"camera and arm are {apart} apart{why}")


def fit_hand_eye(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, arm: ArmModel = PANDA
) -> HandEyeFit:
    """The pose of a calibrated camera (intrinsics, lenses, baseline) from pictures of a board in the hand of `arm`.

    Pictures that contradict the rest, e.g. because the arm was still moving, are omitted. Raises `SkillFailure`
    few_pictures, one_axis, or other_arm if joint angles and poses do not match `arm`.
    """
    first = _fitted(shots, board, camera, arm)
    keep = first.rms_by_shot_px <= _OMITTED_ABOVE * np.median(first.rms_by_shot_px)
    if np.all(keep):
        return first
    return _fitted([shot for shot, kept in zip(first.shots, keep, strict=True) if kept], board, camera, arm)


def _fitted(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, arm: ArmModel) -> HandEyeFit:
    problem = _HandEyeProblem(shots, board, camera)
    problem.reported = _reported_arm(problem, arm)
    starts = {name: solve(problem.T_world_tcp, problem.T_camera_board) for name, solve in METHODS.items()}
    rms = {name: rms_px(problem.errors_px(problem.begin_at(start))) for name, start in starts.items()}
    best = min(rms, key=lambda name: rms[name])
    fit: Any = scipy.optimize.least_squares(
        problem.residuals, problem.begin_at(starts[best]), loss="soft_l1", f_scale=_OUTLIER, x_scale="jac"
    )
    X, Y = problem.poses(fit.x)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    print_scale, baseline_scale = np.exp(fit.x[_SCALES]).tolist()
    pose = geometry.pose_from_matrix(X)
    calibrated = msgspec.structs.replace(
        camera,
        T_world_camera=pose,
        baseline_m=None if camera.baseline_m is None else camera.baseline_m * baseline_scale,
    )
    return HandEyeFit(
        camera=calibrated,
        T_tcp_board=geometry.pose_from_matrix(Y),
        print_scale=print_scale,
        reported=problem.reported,
        joint_offsets_rad=None if problem.reported is None else fit.x[_JOINTS].copy(),
        joint_sigma_rad=None if problem.reported is None else np.sqrt(np.diag(covariance)[_JOINTS]),
        rms_px=rms_px(problem.errors_px(fit.x)),
        rms_by_method_px=rms,
        shots=problem.shots,
        rms_by_shot_px=problem.rms_by_shot_px(fit.x),
        covariance=covariance[_CAMERA, _CAMERA],
    )


def held_out(fit: HandEyeFit, shots: Sequence[BoardShot], board: CharucoBoard) -> HeldOut:
    """Compare the board's poses in the world by camera and by arm, at other poses than the fitted ones."""
    problem = _HandEyeProblem(shots, board, fit.camera, fewest=1, scale=fit.print_scale)
    tools = problem.T_world_tcp
    if fit.joint_offsets_rad is not None and problem.q_rad is not None:
        problem.reported = fit.reported
        tools = problem.tools_at(fit.joint_offsets_rad)
    by_arm, by_report = (poses @ geometry.matrix(fit.T_tcp_board) for poses in (tools, problem.T_world_tcp))
    centre = np.append(fit.print_scale * board.outline_board.mean(axis=0), 1.0)
    return _apart(by_arm, by_report, boards_in_world(fit, problem.shots, board), centre)


def _apart(by_arm: Float64Array, by_report: Float64Array, by_camera: Float64Array, centre: Float64Array) -> HeldOut:
    """Distances and angles between pairs of boards (K, 4, 4) in the world; `middle` (4,) is a point of the board."""
    turns = Rotation.from_matrix(np.swapaxes(by_arm[:, :3, :3], 1, 2) @ by_camera[:, :3, :3])
    apart, reported = (np.linalg.norm(((poses - by_camera) @ centre)[:, :3], axis=1) for poses in (by_arm, by_report))
    return HeldOut(
        position_m=apart,
        reported_m=reported,
        angle_rad=np.asarray(turns.magnitude(), dtype=np.float64),
    )


def check_poses(shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration) -> None:
    """Raise `SkillFailure` disagree if a closed solution shows that poses and pictures contradict each other.

    If another reading of the poses agrees, the message names it. Raises few_pictures and one_axis as well.
    """
    problem = _HandEyeProblem(shots, board, camera)
    tools, boards = problem.T_world_tcp, problem.T_camera_board
    centre = np.append(board.outline_board.mean(axis=0), 1.0)
    given = _contradiction(tools, boards, centre)
    if given.agree:
        return
    for unit, xyzw, inverted, late in itertools.product(_UNITS, (False, True), (False, True), (0, 1, -1, 2, -2)):
        meant: Float64Array = tools.copy()
        meant[:, :3, 3] *= unit
        if xyzw:
            turns = Rotation.from_matrix(tools[:, :3, :3]).as_quat(scalar_first=True)
            meant[:, :3, :3] = Rotation.from_quat(turns, scalar_first=False).as_matrix()
        if inverted:
            meant = np.asarray(np.linalg.inv(meant), dtype=np.float64)
        shown = boards[max(-late, 0) : len(boards) - max(late, 0)]  # late poses belong to earlier pictures
        read = _contradiction(meant[max(late, 0) : len(meant) + min(late, 0)], shown, centre)
        if read.agree:
            readings = [_UNITS[unit], "quaternions as x, y, z, w" * xyzw, "poses of the base in the tool" * inverted]
            readings.append(f"poses {abs(late)} lines off their pictures" * bool(late))
            why = f"; read as {', '.join(filter(None, readings))}, they are {read} apart. "
            raise disagree(
                given, f"{why}Write poses in metres, as w, x, y, z, of the tool, in the line of their picture"
            )
    if np.median(given.position_m) > _UNFITTABLE_M:
        raise disagree(given, f"; {ACCEPTED}")


def _contradiction(T_world_tcp: Float64Array, T_camera_board: Float64Array, centre: Float64Array) -> HeldOut:
    """Differences between the boards' poses by camera and by arm, by a closed solution of all of them."""
    found = shah(T_world_tcp, T_camera_board)
    by_arm = T_world_tcp @ found.T_tcp_board
    return _apart(by_arm, by_arm, found.T_world_camera @ T_camera_board, centre)


def boards_in_world(fit: HandEyeFit, shots: Sequence[BoardShot], board: CharucoBoard) -> Float64Array:
    """``T_world_board`` (N, 4, 4) of boards as the calibrated camera sees them."""
    return geometry.matrix(fit.camera.T_world_camera) @ boards_seen(shots, board, fit.camera, fit.print_scale)


def boards_seen(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, print_scale: float
) -> Float64Array:
    """``T_camera_board`` (N, 4, 4) of boards, from all cameras that show them."""
    nowhere = geometry.pose((0.0, 0.0, 0.0))
    standing = [BoardShot(left=shot.left, right=shot.right, T_world_tcp=nowhere) for shot in shots]
    return _HandEyeProblem(standing, board, camera, fewest=1, scale=print_scale).seen_boards()


class _HandEyeProblem:
    """The corners of all pictures as arrays, and their errors for given unknowns."""

    def __init__(
        self,
        shots: Sequence[BoardShot],
        board: CharucoBoard,
        camera: CameraCalibration,
        fewest: int = FEWEST_PICTURES,
        scale: float = 1.0,
    ) -> None:
        corners = board.corners_board * scale
        seen = [
            (shot, shot.T_world_tcp, T)
            for shot in shots
            if shot.T_world_tcp is not None and (T := board_in_camera(shot.left, corners, camera)) is not None
        ]
        if len(seen) < fewest:
            raise SkillFailure(
                FEW_PICTURES,
                f"{len(seen)} pictures show the board and have a pose of the arm, at least {fewest} are needed; "
                "move the arm to more poses in which the camera sees the board",
            )
        self.shots = tuple(shot for shot, _, _ in seen)
        self.T_world_tcp = np.array([geometry.matrix(tool) for _, tool, _ in seen])
        self.T_camera_board = np.array([geometry.matrix(T) for _, _, T in seen])
        if fewest > 1:
            _check_turns(self.T_world_tcp)
        angles = [shot.q_rad for shot, _, _ in seen if shot.q_rad is not None]
        self.q_rad = np.array(angles, dtype=np.float64) if len(angles) == len(seen) else None
        self.reported: ReportedArm | None = None
        """The model that computes tool poses from joint angles; None: the reported poses are used."""
        self._camera = camera
        self._baseline_m = 0.0 if camera.baseline_m is None else baseline_m(camera)
        parts = [
            (index, side, view.numbers, ideal_pixels(view, camera, side))
            for index, (shot, _, _) in enumerate(seen)
            for side, view in zip(SIDES, (shot.left, shot.right if self._baseline_m else None), strict=True)
            if view is not None
        ]
        counts = [len(part[2]) for part in parts]
        self._shot: Int64Array = np.repeat([part[0] for part in parts], counts)
        self._right: BoolArray = np.repeat([part[1] == 1 for part in parts], counts)
        self._corners_board = corners[np.concatenate([part[2] for part in parts])]
        self._pixels = np.concatenate([part[3] for part in parts])

    def poses(self, x: Float64Array) -> tuple[Float64Array, Float64Array]:
        """``T_world_camera`` and ``T_tcp_board`` (4, 4); the unknowns are turns and shifts relative to the start."""
        return self._X @ motion(x[_CAMERA]), self._Y @ motion(x[_BOARD])

    def begin_at(self, start: HandEyePoses) -> Float64Array:
        """Use a solution as the start of turns and shifts; returns its unknowns."""
        self._X, self._Y = start.T_world_camera, start.T_tcp_board
        return np.zeros(_SCALES.stop + (0 if self.reported is None else len(self.reported.arm.joints)))

    def tools_at(self, offsets_rad: Float64Array) -> Float64Array:
        """``T_world_tcp`` (N, 4, 4) for offsets (J,) [rad] of the joints."""
        if self.reported is None or self.q_rad is None:
            return self.T_world_tcp
        return self.reported.poses(self.q_rad - offsets_rad)

    def residuals(self, x: Float64Array) -> Float64Array:
        """Errors over their standard deviations, of the corners and of the priors."""
        prior = np.concatenate([x[_SCALES] / _SCALE_SIGMA, x[_JOINTS] / JOINT_SIGMA_RAD])
        return np.concatenate([self.errors_px(x).ravel() / _NOISE_PX, prior])

    def errors_px(self, x: Float64Array) -> Float64Array:
        """Errors (N, 2) [px] of all corners."""
        X, Y = self.poses(x)
        boards = np.linalg.inv(X) @ self.tools_at(x[_JOINTS]) @ Y
        return self._errors_of(boards, *np.exp(x[_SCALES]).tolist())

    def rms_by_shot_px(self, x: Float64Array) -> Float64Array:
        """Root mean square (N,) [px] of the errors of each picture."""
        squares = np.sum(self.errors_px(x) ** 2, axis=1)
        return np.sqrt(np.bincount(self._shot, squares) / np.bincount(self._shot))

    def seen_boards(self) -> Float64Array:
        """``T_camera_board`` (N, 4, 4) by both cameras."""

        def moved(x: Float64Array) -> Float64Array:
            return self.T_camera_board @ np.array([motion(part) for part in x.reshape(-1, 6)])

        count = len(self.T_camera_board)
        pattern = self._shot[:, None].repeat(2, axis=1).ravel()[:, None] == np.arange(count).repeat(6)[None, :]
        fit: Any = scipy.optimize.least_squares(
            lambda x: self._errors_of(moved(x), 1.0, 1.0).ravel() / _NOISE_PX,
            np.zeros(6 * count),
            loss="soft_l1",
            f_scale=_OUTLIER,
            x_scale="jac",
            jac_sparsity=pattern.astype(np.int64),
        )
        return moved(fit.x)

    def _errors_of(self, boards: Float64Array, print_scale: float, baseline_scale: float) -> Float64Array:
        T = boards[self._shot]
        p = np.einsum("nij,nj->ni", T[:, :3, :3], print_scale * self._corners_board) + T[:, :3, 3]
        p[self._right, 0] -= baseline_scale * self._baseline_m
        camera = self._camera
        focal, centre = np.array([camera.fx_px, camera.fy_px]), np.array([camera.cx_px, camera.cy_px])
        return focal * p[:, :2] / p[:, 2:] + centre - self._pixels


def _reported_arm(problem: _HandEyeProblem, arm: ArmModel) -> ReportedArm | None:
    """The frames of the reported poses; None without joint angles. Raises `SkillFailure` other_arm."""
    q = problem.q_rad
    if q is None:
        return None
    if q.shape[1] != len(arm.joints):
        raise SkillFailure(
            OTHER_ARM, f"{q.shape[1]} joint angles are given, and the {arm.title} has {len(arm.joints)} joints"
        )
    # T_world_reported = T_world_base K T_tcp_reported is a hand-eye problem as well, and an exact one.
    by_arm = tcp_matrices(arm, q)
    found = shah(problem.T_world_tcp, by_arm)
    reported = ReportedArm(
        arm=arm,
        T_world_base=found.T_world_camera,
        T_tcp_reported=np.asarray(np.linalg.inv(found.T_tcp_board), dtype=np.float64),
    )
    off_m = float(np.linalg.norm((reported.poses(q) - problem.T_world_tcp)[:, :3, 3], axis=1).max())
    if off_m > _OTHER_ARM_M:
        raise SkillFailure(
            OTHER_ARM,
            f"the poses of the tool are up to {off_m * 1e3:.0f} mm from where the {arm.title} would be at the joint "
            "angles; are the angles in radians, and of that arm? Without them the offsets of the joints are not fitted",
        )
    return reported


def _check_turns(T_world_tcp: Float64Array) -> None:
    """Raise `SkillFailure` one_axis if all poses turn about one axis only, or too little."""
    turns = Rotation.from_matrix(np.swapaxes(T_world_tcp[:1, :3, :3], 1, 2) @ T_world_tcp[:, :3, :3]).as_rotvec()
    spread = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns))
    if spread[1] < _LEAST_TURN_RAD / np.sqrt(len(turns)):
        raise SkillFailure(
            ONE_AXIS,
            "the board turns about one axis only, or too little; turn it by 20° and more about two axes between the "
            "pictures, or the pose of the camera is not determined",
        )


def motion(x: Float64Array) -> Float64Array:
    """A turn (rotation vector) and a shift as a matrix (4, 4)."""
    return geometry.homogeneous(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:])
