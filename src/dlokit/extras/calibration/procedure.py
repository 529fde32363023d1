"""From pictures of a board to a calibrated camera: corners, optics, pose and accuracy. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.charuco import find_board
from dlokit.extras.calibration.hand_eye import (
    ACCEPTED,
    HandEyeFit,
    HeldOut,
    check_poses,
    disagree,
    fit_hand_eye,
    held_out,
)
from dlokit.extras.calibration.stereo_rig import (
    FEW_PICTURES,
    FEWEST_PICTURES,
    BoardShot,
    RigFit,
    calibrate_rig,
    split_held_out,
)
from dlokit.skills.perception.config import BoxConfig
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FEWEST_SHOTS = FEWEST_PICTURES + 2
"""Least number of pictures of the board; two are held out."""
_MOST_CONTRADICTING = 0.25
"""Largest fraction of contradicting pictures; with more, the correct ones are unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenPicture:
    """A picture or a pair, with the pose of the arm."""

    left: UInt8Array  # (height, width, 3) RGB or (height, width)
    right: UInt8Array | None = None
    T_world_tcp: Pose | None = None
    q_rad: Float64Array | None = None  # (J,) where they are known
    name: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedPose:
    """A calibrated camera, with the agreement of camera and arm."""

    rig: RigFit | None
    """The optics, if they were fitted to the same pictures."""
    fit: HandEyeFit
    """The fit of all pictures."""
    partial: HandEyeFit
    """The fit without the held-out pictures."""
    kept: Sequence[BoardShot]
    """The held-out pictures."""
    apart: HeldOut
    """Camera against arm at the held-out poses, by the fit without them."""

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
) -> CalibratedPose:
    """The pose of a camera whose optics are known, or fitted to the same pictures; `arm` holds the board.

    Pictures without a pose of the arm are omitted.
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
    check_poses(posed, board, optics)
    fit = fit_hand_eye(posed, board, optics, arm)
    # Pictures that contradict the rest are no evidence for the agreement of the rest.
    agreed = fit.shots if len(fit.shots) >= FEWEST_SHOTS else posed
    others, kept = split_held_out(agreed)
    partial = fit_hand_eye(others, board, optics, arm)
    apart = held_out(partial, kept, board)
    if not apart.agree or len(fit.shots) < (1.0 - _MOST_CONTRADICTING) * len(posed):
        omitted = f"{len(posed) - len(fit.shots)} of {len(posed)} pictures contradict the rest"
        raise disagree(apart, f" at poses that were not fitted, and {omitted}; {ACCEPTED}")
    return CalibratedPose(rig=rig, fit=fit, partial=partial, kept=kept, apart=apart)
