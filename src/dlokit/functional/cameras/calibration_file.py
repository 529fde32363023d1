"""A camera's calibration as a TOML file that people can read and edit.

The file may also contain the quality of the calibration: the tables `residual`, `table` and `latency` are for
people.
"""

import tomllib
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np
import tomli_w

from dlokit.errors import ConfigError
from dlokit.geometry import pose
from dlokit.types.image import CameraCalibration
from dlokit.types.message import Value
from dlokit.types.pose import Pose

V = TypeVar("V", bound=Value)


class CalibrationResidual(Value, frozen=True, kw_only=True, eq=False):
    """The errors of a calibration in the pictures that it was made from."""

    method: str
    pictures: int
    rms_px: float
    """Error of the board's corners in the pictures, root mean square [px]."""
    held_out_m: float | None = None
    """Distance between the board's poses by camera and by arm, at poses that were not fitted, 95th percentile [m]."""
    held_out_deg: float | None = None
    """The same as an angle [°]."""
    corners_m: float | None = None
    """Standard deviation of a point at the corners of the workspace by the camera's pose, the largest [m]; of
    `dlokit calibrate stereo`, at the corners of the space that the boards have filled, by the optics."""
    rows_px: float | None = None
    """Distance of the rows of a corner in both rectified pictures, in pictures that were not fitted, 95th percentile
    [px]."""
    board_m: float | None = None
    """Distance of corners in space, as both cameras see them, from the board in those pictures, 95th percentile [m]."""
    print_scale: float | None = None
    """Size of the printed board over its nominal size."""
    reported_m: float | None = None
    """As `held_out_m`, with the poses that the arm reports, which include the offsets of its joints [m]."""
    joint_offsets_deg: tuple[float, ...] | None = None
    """Reported minus true angle of each joint of the arm that held the board [°]. A run does not use them."""
    joint_sigma_deg: tuple[float, ...] | None = None
    """Standard deviation of each [°]; 0.1 where the pictures do not determine it, as for the first and last joint."""


class MeasuredTable(Value, frozen=True, kw_only=True, eq=False):
    """The table's top as measured by the calibrated camera."""

    height_m: float
    """Height in the world in the middle of the workspace [m]; dlokit assumes 0."""
    tilt_x_deg: float
    """Turn about the world's x axis against level [°]."""
    tilt_y_deg: float
    residual_m: float
    """Root mean square of the corners' distances from the plane [m]."""


class MeasuredLatency(Value, frozen=True, kw_only=True, eq=False):
    """The measurement of `stamps_late_s`."""

    date: str
    """Day of the measurement, ISO 8601."""
    pictures: int
    """Pictures of the board in motion that were used."""
    uncertainty_s: float
    """Half the interval that holds the result with 95 % [s]."""
    rms_px: float
    """Error of the board's corners in the pictures with the result, root mean square [px]."""
    uncorrected_rms_px: float
    """The same with uncorrected stamps [px]."""


_PARTS: dict[type[Value], str] = {CalibrationResidual: "residual", MeasuredTable: "table", MeasuredLatency: "latency"}
_UNREADABLE = (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, msgspec.ValidationError)
OVER_THE_TABLE = pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))
"""Pose of a camera without a calibrated one: 1 m over the table, looking straight down."""


def read_calibration(path: Path) -> CameraCalibration:
    """The calibration in a file. Raises `ConfigError` when it is missing or incomplete."""
    try:
        plain = tomllib.loads(path.read_text(encoding="utf-8"))
        plain = {key: value for key, value in plain.items() if key not in _PARTS.values()}
        return msgspec.convert(plain, CameraCalibration, dec_hook=_array)
    except _UNREADABLE as error:
        raise ConfigError(
            f"calibration {path} cannot be used: {error}; it needs width_px, height_px, fx_px, fy_px, cx_px, cy_px, "
            "for a stereo pair baseline_m, and a table T_world_camera with position_m (3) and wxyz (4)"
        ) from error


def read_part(path: Path | None, kind: type[V]) -> V | None:
    """A further part of a calibration file: its residual, the table, or the latency measurement.

    None without a file, or when the file lacks the part. Raises `ConfigError`.
    """
    if path is None:
        return None
    try:
        plain = tomllib.loads(path.read_text(encoding="utf-8")).get(_PARTS[kind])
        return None if plain is None else msgspec.convert(plain, kind)
    except _UNREADABLE as error:
        raise ConfigError(
            f"the part [{_PARTS[kind]}] of {path} cannot be read: {error}; `dlokit calibrate` writes it, delete it"
        ) from error


def write_calibration(
    path: Path,
    calibration: CameraCalibration,
    residual: CalibrationResidual | None = None,
    table: MeasuredTable | None = None,
    latency: MeasuredLatency | None = None,
) -> None:
    """Write a file that `read_calibration` reads."""
    plain = _plain(calibration)
    for part in (residual, table, latency):
        if part is not None:
            plain[_PARTS[type(part)]] = _plain(part)
    path.write_text(tomli_w.dumps(plain), encoding="utf-8")


def has_pose(calibration: CameraCalibration) -> bool:
    """Whether a calibration contains the camera's pose; a pose at the world's origin means that it does not."""
    return bool(np.any(calibration.T_world_camera.position_m))


def check_has_pose(file: str, calibration: CameraCalibration) -> None:
    """Raise `ConfigError` for a calibration of the optics alone."""
    if not has_pose(calibration):
        raise ConfigError(
            f"calibration {file} is of the optics alone and does not say where the camera stands: call "
            "`dlokit calibrate handeye --intrinsics` with it, and give the file that this writes"
        )


def pose_from(file: str) -> Pose:
    """The pose in a file; `OVER_THE_TABLE` without a file. Raises `ConfigError` when the file has no pose."""
    if not file:
        return OVER_THE_TABLE
    calibration = read_calibration(Path(file))
    check_has_pose(file, calibration)
    return calibration.T_world_camera


def check_same_camera(file: str, wanted: CameraCalibration, camera: CameraCalibration) -> None:
    """Raise `ConfigError` when the calibration of a file is for another camera, or for another picture size.

    A file without a serial fits every camera: a person wrote it.
    """
    if wanted.serial and not camera.serial:
        raise ConfigError(
            f"calibration {file} is of the camera {wanted.serial!r}, and this one reports no serial number: if it is "
            f"that camera, remove the line serial = {wanted.serial!r} from the file; any camera then accepts it"
        )
    if wanted.serial and wanted.serial != camera.serial:
        raise ConfigError(
            f"calibration {file} is of the camera {wanted.serial!r}, this one is {camera.serial!r}: give the file of "
            "this camera, or calibrate it with `dlokit calibrate handeye`"
        )
    size, present = (wanted.width_px, wanted.height_px), (camera.width_px, camera.height_px)
    if size != present:
        raise ConfigError(
            f"calibration {file} is for pictures of {size[0]} by {size[1]} px, the camera takes {present[0]} by "
            f"{present[1]} px: set that size, or calibrate the camera with `dlokit calibrate handeye`"
        )


def _plain(value: Value) -> dict[str, Any]:
    plain = msgspec.to_builtins(value, enc_hook=lambda array: np.asarray(array).tolist())
    return {key: part for key, part in plain.items() if part is not None}


def _array(wanted: Any, value: Any) -> Any:
    dtype = get_args(get_args(wanted)[1])[0]
    return np.array(value, dtype=dtype)
