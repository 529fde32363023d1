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
DISAGREE = "disagree"
LARGEST_APART_M, LARGEST_APART_RAD = 0.020, float(np.radians(2.0))
"""Camera and arm that are farther apart at held-out poses contradict each other. An arm that nobody has calibrated errs
by 0.1° in each of seven joints: three standard deviations are 0.8°, and 12 mm at a reach of 0.85 m. One picture of a
small, distant board tells its place to 5 mm and its turn to 1°; other mistakes put them 100 mm apart and more."""
_PERCENTILE = 95.0
_MOST_LEFT_OUT = 0.25
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
    _check_usual_mistakes(posed, board, optics, T_world_base)
    fit = fit_hand_eye(posed, board, optics, arm)
    last: BoolArray = np.arange(len(posed)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    others, kept = ([shot for shot, is_last in zip(posed, last, strict=True) if is_last == part] for part in (0, 1))
    partial = fit_hand_eye(others, board, optics, arm)
    # A picture that contradicts all others says nothing of how well these agree.
    kept = [shot for shot in kept if shot in fit.shots] or kept
    apart = held_out(partial, kept, board)
    off_m, off_rad = (float(np.percentile(off, _PERCENTILE)) for off in (apart.position_m, apart.angle_rad))
    left_out = len(posed) - len(fit.shots)
    if not _agree(off_m, off_rad) or left_out > _MOST_LEFT_OUT * len(posed):
        raise SkillFailure(
            DISAGREE,
            f"camera and arm are {_apart(off_m, off_rad)} apart at poses that were not fitted, and {left_out} of "
            f"{len(posed)} pictures contradict the others; {_apart(LARGEST_APART_M, LARGEST_APART_RAD)} and a quarter "
            "are the most that is accepted. Look for pictures that do not show the pose of their line",
        )
    return CalibratedPose(rig=rig, fit=fit, partial=partial, kept=kept, apart=apart)


def _apart(off_m: float, off_rad: float) -> str:
    return f"{off_m * 1e3:.1f} mm and {np.degrees(off_rad):.1f}°"


def _check_usual_mistakes(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, T_world_base: Pose | None
) -> None:
    """Raise `SkillFailure` disagree where the poses contradict the pictures, and read otherwise they do not.

    A closed solution tells within milliseconds; where no other reading is better, the robust fit decides.
    """
    from_world = np.eye(4) if T_world_base is None else geometry.matrix(geometry.inverse(T_world_base))
    pairs = [
        (from_world @ geometry.matrix(shot.T_world_tcp), geometry.matrix(T))
        for shot in shots
        if shot.T_world_tcp is not None and (T := board_in_camera(shot.left, board.corners_board, camera)) is not None
    ]
    if len(pairs) < FEWEST_SHOTS:
        return
    tools, boards = (np.array(part) for part in zip(*pairs, strict=True))
    centre = np.append(board.outline_board.mean(axis=0), 1.0)
    as_given = _contradiction(tools, boards, centre)
    if _agree(*as_given):
        return
    for unit, xyzw, inverted, late in itertools.product(_UNITS, (False, True), (False, True), (0, 1, -1, 2, -2)):
        shown = slice(max(-late, 0), len(boards) - max(late, 0))  # poses that are late belong to earlier pictures
        reread = _reread(tools, unit, xyzw=xyzw, inverted=inverted)[max(late, 0) : len(tools) + min(late, 0)]
        off = _contradiction(reread, boards[shown], centre)
        if _agree(*off):
            told = (_UNITS[unit], "quaternions as x, y, z, w" * xyzw, "poses of the base in the tool" * inverted)
            shifted = f"poses {abs(late)} lines off their pictures" * bool(late)
            raise SkillFailure(
                DISAGREE,
                f"camera and arm are {_apart(*as_given)} apart; read as {', '.join(filter(None, (*told, shifted)))}, "
                f"the poses agree with the pictures to {_apart(*off)}. Write them in metres, as w, x, y, z, of the tool "
                "in the base, each in the line of its picture",
            )


def _reread(tools: Float64Array, unit: float, *, xyzw: bool, inverted: bool) -> Float64Array:
    """Poses (N, 4, 4) as they are meant where they were written in another way."""
    meant = tools.copy()
    meant[:, :3, 3] *= unit
    if xyzw:
        turns = Rotation.from_matrix(tools[:, :3, :3]).as_quat(scalar_first=True)
        meant[:, :3, :3] = Rotation.from_quat(turns, scalar_first=False).as_matrix()
    return np.asarray(np.linalg.inv(meant), dtype=np.float64) if inverted else meant


def _agree(off_m: float, off_rad: float) -> bool:
    return off_m <= LARGEST_APART_M and off_rad <= LARGEST_APART_RAD


def _contradiction(
    T_world_tcp: Float64Array, T_camera_board: Float64Array, centre: Float64Array
) -> tuple[float, float]:
    """How far apart [m], [rad] camera and arm have a point (4,) of the board, by a closed solution."""
    found = shah(T_world_tcp, T_camera_board)
    by_arm, by_camera = T_world_tcp @ found.T_tcp_board, found.T_world_camera @ T_camera_board
    turns = Rotation.from_matrix(np.swapaxes(by_arm[:, :3, :3], 1, 2) @ by_camera[:, :3, :3]).magnitude()
    off_m = np.linalg.norm((by_arm - by_camera) @ centre, axis=1)
    return float(np.percentile(off_m, _PERCENTILE)), float(np.percentile(turns, _PERCENTILE))
