"""The plane of the table's top, from a calibrated camera's pictures of a board on the table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.hand_eye import boards_seen
from dlokit.extras.calibration.stereo_rig import FEW_PICTURES, BoardShot
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration

_LARGEST_RESIDUAL_M = 0.003
"""Five times the residual of a flat board's corners [m]; a board in a hand is off by centimetres."""


@dataclass(frozen=True, kw_only=True)
class TablePlane:
    """A plane near the world's z = 0."""

    height_m: float
    """Height at the requested place [m]."""
    tilt_x_rad: float
    """Turn about the world's x axis [rad]."""
    tilt_y_rad: float
    residual_m: float
    """Root mean square of the corners' distances [m]."""


def table_plane(
    shots: Sequence[BoardShot],
    board: CharucoBoard,
    camera: CameraCalibration,
    *,
    print_scale: float,
    thickness_m: float,
    at_m: tuple[float, float],
) -> TablePlane:
    """The plane below a board of known thickness on the table, from one place or several.

    `print_scale` is the size of its print over the nominal size: an error of 0.2 % moves the plane by 2 mm.
    `at_m` is the place (x, y) in the world at which the height is returned. Raises `SkillFailure` few_pictures or
    no_plane.
    """
    if not shots:
        raise SkillFailure(
            FEW_PICTURES, "no picture shows the board; lay it face up on the table, in view of the camera"
        )
    corners = _corners_world(shots, board, camera, print_scale)
    middle = corners.mean(axis=0)
    # z = z0 + a x + b y: the distances are vertical, and the table is nearly level.
    A = np.column_stack([np.ones(len(corners)), corners[:, :2] - middle[:2]])
    (z, by_x, by_y), *_ = np.linalg.lstsq(A, corners[:, 2], rcond=None)
    residual_m = float(np.sqrt(np.mean((A @ np.array([z, by_x, by_y]) - corners[:, 2]) ** 2)))
    if residual_m > _LARGEST_RESIDUAL_M:
        raise SkillFailure(
            "no_plane",
            f"the corners of the board are {residual_m * 1e3:.1f} mm off a plane, {_LARGEST_RESIDUAL_M * 1e3:.0f} mm "
            "are accepted; lay the board flat on the table in each picture, and take the calibration of this camera",
        )
    height_m = float(z + by_x * (at_m[0] - middle[0]) + by_y * (at_m[1] - middle[1])) - thickness_m
    return TablePlane(
        height_m=height_m,
        tilt_x_rad=float(np.arctan(by_y)),
        tilt_y_rad=float(-np.arctan(by_x)),
        residual_m=residual_m,
    )


def _corners_world(
    shots: Sequence[BoardShot], board: CharucoBoard, camera: CameraCalibration, print_scale: float
) -> Float64Array:
    X = geometry.matrix(camera.T_world_camera)
    corners = print_scale * board.corners_board
    boards = boards_seen(shots, board, camera, print_scale)
    return np.concatenate([corners @ T[:3, :3].T + T[:3, 3] for T in X @ boards])
