"""From pictures of a board to a calibrated camera: corners, optics, pose, and how good it is. Pure."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.skills.perception.calibration.charuco import find_board
from dlokit.skills.perception.calibration.hand_eye import HandEyeFit, HeldOut, fit_hand_eye, held_out
from dlokit.skills.perception.calibration.hand_eye_start import shah
from dlokit.skills.perception.calibration.stereo_rig import (
    FEW_PICTURES,
    FEWEST_PICTURES,
    BoardShot,
    RigFit,
    board_in_camera,
    calibrate_rig,
)
from dlokit.skills.perception.config import BoxConfig
from dlokit.types.arrays import BoolArray, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FEWEST_SHOTS = FEWEST_PICTURES + 2
"""Pictures of the board that are needed, two of them to be held out."""
HELD_OUT_EVERY = 5
"""One in so many pictures is held out of a second fit, which is compared with it."""
LARGEST_APART_M, LARGEST_APART_RAD = 0.020, float(np.radians(2.0))
"""Camera and arm that are farther apart at held-out poses contradict each other. An arm that nobody has calibrated errs
by 0.1° in each of seven joints: three standard deviations are 0.8°, and 12 mm at a reach of 0.85 m. One picture of a
small, distant board tells its place to 5 mm and its turn to 1°; other mistakes put them 100 mm apart and more."""
_HOPELESS = 5.0
"""So many times farther apart in the median picture, and no robust fit finds which of the poses are right."""
_LEFT_OUT = 0.25
"""Fraction of the pictures that may contradict the others: of more it is not known which of them are right."""
_UNITS = {1.0: "", 0.001: "positions in millimetres", 0.01: "positions in centimetres"}


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenPicture:
    """A picture or a pair, and where the arm was."""

    left: UInt8Array  # (height, width, 3) RGB or (height, width)
    right: UInt8Array | None = None
    T_world_tcp: Pose | None = None
    q_rad: Float64Array | None = None  # (J,) where they are known
    name: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedPose:
    """A calibrated camera, and how well camera and arm agree."""

    rig: RigFit | None
    """The optics, where they were fitted to the same pictures."""
    fit: HandEyeFit
    """The fit of all pictures."""
    partial: HandEyeFit
    """The fit without the pictures that are held out."""
    kept: Sequence[BoardShot]
    """Those pictures."""
    apart: HeldOut
    """Camera against arm at the held-out poses, by a fit of the others."""

    @property
    def corners_m(self) -> Float64Array:
        """Standard deviation (8,) [m] of a point at each corner of the workspace, by the camera's pose."""
        return self.fit.deviation_m(workspace_corners())


def workspace_corners() -> Float64Array:
    """The corners (8, 3) [m] of the box in which a DLO may be."""
    box = BoxConfig()
    axes = [np.array(pair) for pair in zip(box.lower_world, box.upper_world, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def find_shots(pictures: Sequence[TakenPicture], board: CharucoBoard) -> list[BoardShot]:
    """The pictures whose left camera shows the board, as corners."""
    shots: list[BoardShot] = []
    for picture in pictures:
        left = find_board(picture.left, board)
        if left is not None:
            right = None if picture.right is None else find_board(picture.right, board)
            shots.append(BoardShot(left=left, right=right, T_world_tcp=picture.T_world_tcp, q_rad=picture.q_rad))
    return shots


def calibrate_pose(
    shots: Sequence[BoardShot],
    board: CharucoBoard,
    camera: CameraCalibration,
    *,
    fit_optics: bool,
    arm: ArmModel = PANDA,
    T_world_base: Pose | None = None,
) -> CalibratedPose:
    """The pose of a camera whose optics are known, or fitted to the same pictures; `arm` holds the board.

    Pictures without a pose of the arm are left out. `T_world_base` is where the arm stands that reports the poses.
    Raises `SkillFailure` few_pictures, no_rig, one_axis, other_arm, or disagree.
    """
    posed = [shot for shot in shots if shot.T_world_tcp is not None]
    if len(posed) < FEWEST_SHOTS:
        show = "show the board" if len(posed) == len(shots) else "show the board and have a pose of the arm"
        raise SkillFailure(
            FEW_PICTURES,
            f"{len(posed)} pictures {show}, at least {FEWEST_SHOTS} are needed; move the arm to more poses in "
            "which the camera sees the board",
        )
    rig = calibrate_rig(posed, board, camera) if fit_optics else None
    optics = camera if rig is None else rig.camera
    _check_poses(posed, board, optics, T_world_base)
    fit = fit_hand_eye(posed, board, optics, arm)
    # Pictures that contradict all others say nothing of how well these agree.
    agreed = fit.shots if len(fit.shots) >= FEWEST_SHOTS else posed
    last: BoolArray = np.arange(len(agreed)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    others, kept = ([shot for shot, is_last in zip(agreed, last, strict=True) if is_last == part] for part in (0, 1))
    partial = fit_hand_eye(others, board, optics, arm)
    apart = held_out(partial, kept, board)
    if not _agree(apart.position_m, apart.angle_rad) or len(fit.shots) < (1.0 - _LEFT_OUT) * len(posed):
        left_out = f", and {len(posed) - len(fit.shots)} of {len(posed)} pictures contradict the others"
        raise _disagree(apart.position_m, apart.angle_rad, f" at poses that were not fitted{left_out}; {_ACCEPTED}")
    return CalibratedPose(rig=rig, fit=fit, partial=partial, kept=kept, apart=apart)


def _agree(off_m: Float64Array, off_rad: Float64Array) -> bool:
    return bool(_worst(off_m) <= LARGEST_APART_M and _worst(off_rad) <= LARGEST_APART_RAD)


def _worst(off: Float64Array) -> float:
    return float(np.percentile(off, 95.0))


def _apart(off_m: float, off_rad: float) -> str:
    return f"{off_m * 1e3:.1f} mm and {np.degrees(off_rad):.1f}°"


def _disagree(off_m: Float64Array, off_rad: Float64Array, why: str) -> SkillFailure:
    return SkillFailure("disagree", f"camera and arm are {_apart(_worst(off_m), _worst(off_rad))} apart{why}")


_ACCEPTED = (
    f"{_apart(LARGEST_APART_M, LARGEST_APART_RAD)} are accepted, for a quarter of the pictures more. Look for pictures "
    "that do not show the pose of their line"
)


def _check_poses(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, T_world_base: Pose | None
) -> None:
    """Raise `SkillFailure` disagree where a closed solution shows that poses and pictures contradict each other.

    Where they agree when the poses are read otherwise, it says how.
    """
    from_world = np.eye(4) if T_world_base is None else geometry.matrix(geometry.inverse(T_world_base))
    pairs = [
        (from_world @ geometry.matrix(shot.T_world_tcp), geometry.matrix(T))
        for shot in shots
        if shot.T_world_tcp is not None and (T := board_in_camera(shot.left, board.corners_board, camera)) is not None
    ]
    if len(pairs) < FEWEST_SHOTS:
        return  # the fit says so
    tools, boards = (np.array(part) for part in zip(*pairs, strict=True))
    centre = np.append(board.outline_board.mean(axis=0), 1.0)
    given = _contradiction(tools, boards, centre)
    if _agree(*given):
        return
    for unit, xyzw, inverted, late in itertools.product(_UNITS, (False, True), (False, True), (0, 1, -1, 2, -2)):
        meant = tools.copy()
        meant[:, :3, 3] *= unit
        if xyzw:
            turns = Rotation.from_matrix(tools[:, :3, :3]).as_quat(scalar_first=True)
            meant[:, :3, :3] = Rotation.from_quat(turns, scalar_first=False).as_matrix()
        if inverted:
            meant = np.linalg.inv(meant)
        shown = boards[max(-late, 0) : len(boards) - max(late, 0)]  # poses that are late belong to earlier pictures
        read = _contradiction(meant[max(late, 0) : len(meant) + min(late, 0)], shown, centre)
        if _agree(*read):
            told = [_UNITS[unit], "quaternions as x, y, z, w" * xyzw, "poses of the base in the tool" * inverted]
            told.append(f"poses {abs(late)} lines off their pictures" * bool(late))
            raise _disagree(
                *given,
                f"; read as {', '.join(filter(None, told))}, they are {_apart(*map(_worst, read))} apart. Write poses in "
                "metres, as w, x, y, z, of the tool in the base, each in the line of its picture",
            )
    if np.median(given[0]) > _HOPELESS * LARGEST_APART_M:
        raise _disagree(*given, f"; {_ACCEPTED}")


def _contradiction(
    T_world_tcp: Float64Array, T_camera_board: Float64Array, centre: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """How far apart (N,) [m], [rad] camera and arm have a point (4,) of the board, by a closed solution."""
    found = shah(T_world_tcp, T_camera_board)
    by_arm, by_camera = T_world_tcp @ found.T_tcp_board, found.T_world_camera @ T_camera_board
    turns = Rotation.from_matrix(np.swapaxes(by_arm[:, :3, :3], 1, 2) @ by_camera[:, :3, :3])
    return np.linalg.norm((by_arm - by_camera) @ centre, axis=1), np.asarray(turns.magnitude(), dtype=np.float64)
