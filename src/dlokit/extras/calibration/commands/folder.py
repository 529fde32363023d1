"""A folder of pictures of a calibration board, which a calibration reads, and a calibration in the cell writes.

``left_NAME.png``, for a stereo pair ``right_NAME.png`` beside it, and for a board in an arm's hand ``poses.csv``: a
header, then a line per picture with its NAME, the pose of the tool (x, y, z [m], quaternion w, x, y, z) in the world
and, if they are known, the angles of all joints [rad]. Under the headings rx_rad, ry_rad, rz_rad the turn is a rotation
vector, as UR's controllers report it: along the axis, as long as the angle [rad]. Optional ``calibration.toml``: size,
serial and approximate focal length.

For a moving arm: ``left_NAME.png``; ``stamps.csv``, a header, then NAME and stamp [ns] of each; and
``states.csv``, a header, then the stamp [ns] of each state of the arm and the pose of its tool, as above.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.default_cameras import REFERENCE_FOCAL_PX, REFERENCE_WIDTH_PX
from dlokit.errors import BadValue, InputError
from dlokit.extras.calibration.latency import ToolTrack
from dlokit.extras.calibration.procedure import TakenPicture
from dlokit.functional.cameras.calibration_file import read_calibration, write_calibration
from dlokit.geometry.camera import centred_camera
from dlokit.recording.channels import in_order
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

POSES, CALIBRATION = "poses.csv", "calibration.toml"
_HEADER = ("name", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
_PLACE_COLUMNS = 3
_QUATERNION, _ROTATION_VECTOR = ("qw", "qx", "qy", "qz"), ("rx", "ry", "rz")
_LONGEST_TURN_RAD = 2.0 * np.pi + 0.01
"""Greatest length of a rotation vector: one turn, and rounding. A longer one is in degrees."""
_NORM_TOLERANCE = 0.01
"""Tolerance of a quaternion's norm for two decimals; other norms belong to another quantity."""
STAMPS, STATES = "stamps.csv", "states.csv"
STATES_HEADER = ("stamp_ns", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedMotion:
    """Pictures of a board in the hand of a moving arm."""

    pictures: Sequence[UInt8Array]  # each (height, width, 3) RGB
    stamps_ns: Sequence[int]
    track: ToolTrack


def read_pictures(folder: Path) -> list[TakenPicture]:
    """The pictures of a folder, ordered by the numbers in their names. Raises `InputError` if one cannot be used."""
    lefts = in_order(folder.glob("left_*.png"))
    if not lefts:
        raise InputError(
            f"{folder} has no left_*.png; record pictures of the board as left_NAME.png, for a stereo camera with "
            f"right_NAME.png beside each, and for `dlokit calibrate handeye` the poses of the arm in {POSES}."
        )
    poses = _read_poses(folder / POSES) if (folder / POSES).exists() else {}
    names = [left.stem.removeprefix("left_") for left in lefts]
    if poses and poses.keys().isdisjoint(names):
        raise InputError(
            f"{folder / POSES} has no line of any picture: its first NAME is {next(iter(poses))!r}, that of the first "
            f"picture {names[0]!r}; call both the same."
        )
    pictures: list[TakenPicture] = []
    for left, name in zip(lefts, names, strict=True):
        right = left.with_name(f"right_{name}.png")
        T, q = poses.get(name, (None, None))
        pixels = _read(left), _read(right) if right.exists() else None
        pictures.append(TakenPicture(left=pixels[0], right=pixels[1], T_world_tcp=T, q_rad=q, name=name))
    sizes = {side.shape[:2] for picture in pictures for side in (picture.left, picture.right) if side is not None}
    if len(sizes) > 1:
        raise InputError(f"{folder}: the pictures have several sizes; put those of one camera into a folder.")
    return pictures


def read_motion(folder: Path) -> RecordedMotion:
    """Pictures, stamps and states of a motion. Raises `InputError` if one is missing or cannot be used."""
    lefts = {path.stem.removeprefix("left_"): path for path in in_order(folder.glob("left_*.png"))}
    stamps = {row[0].strip(): _whole(folder / STAMPS, number, row[1:]) for number, row in _rows(folder / STAMPS)}
    alone = [name for name in (*lefts, *stamps) if name not in lefts or name not in stamps]
    if not lefts or alone:
        raise InputError(
            f"{folder} has {len(lefts)} pictures left_NAME.png and {len(stamps)} lines in {STAMPS}; each picture needs "
            f"a line NAME,stamp_ns, and each line its picture. Alone are: {', '.join(alone) or 'none'}."
        )
    return RecordedMotion(
        pictures=[_read(path) for path in lefts.values()],
        stamps_ns=[stamps[name] for name in lefts],
        track=_read_states(folder / STATES),
    )


def _read_states(path: Path) -> ToolTrack:
    stamps_ns: list[int] = []
    poses: list[Pose] = []
    turn = _turn_of(path)
    for number, row in _rows(path):
        stamps_ns.append(_whole(path, number, row))
        try:
            poses.append(_pose([float(value) for value in row[1:]], turn))
        except ValueError as error:
            raise InputError(
                f"{path}, line {number}: {error}; each line is {','.join(STATES_HEADER)}, or has a rotation vector "
                "under the headings rx_rad,ry_rad,rz_rad for the quaternion."
            ) from error
    if len(poses) < 2 or any(later <= earlier for earlier, later in pairwise(stamps_ns)):
        raise InputError(f"{path} needs two states or more, each later than the one before.")
    return ToolTrack.of(stamps_ns, poses)


def write_motion(folder: Path, motion: RecordedMotion, camera: CameraCalibration) -> None:
    """Write the files for `read_motion`, and the camera."""
    for number, pixels in enumerate(motion.pictures):
        write_picture(folder / f"left_{number:03d}.png", pixels)
    stamps = [[f"{number:03d}", stamp_ns] for number, stamp_ns in enumerate(motion.stamps_ns)]
    _write_rows(folder / STAMPS, [["name", "stamp_ns"], *stamps])
    track = motion.track
    states = [
        [stamp_ns, *map(repr, (*place, *turn))]
        for stamp_ns, place, turn in zip(
            track.stamps_ns.tolist(), track.position_m.tolist(), track.wxyz.tolist(), strict=True
        )
    ]
    _write_rows(folder / STATES, [STATES_HEADER, *states])
    write_calibration(folder / CALIBRATION, camera)


def write_picture(file: Path, pixels: UInt8Array) -> None:
    """Write a picture (height, width), or (height, width, 3) in RGB, as PNG. Raises `InputError` if it fails."""
    if not cv2.imwrite(str(file), pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)):
        raise InputError(f"{file} cannot be written: is the disk full, or the folder gone or read-only?")


def camera_of_folder(folder: Path, picture: UInt8Array, serial: str, date: str) -> CameraCalibration:
    """The camera of a folder: its ``calibration.toml``, or only its size."""
    height_px, width_px = picture.shape[:2]
    if (folder / CALIBRATION).exists():
        camera = read_calibration(folder / CALIBRATION)
        if (camera.width_px, camera.height_px) != (width_px, height_px):
            raise InputError(
                f"{folder / CALIBRATION} is for pictures of {camera.width_px} by {camera.height_px} px, these have "
                f"{width_px} by {height_px} px; put the calibration of this camera there, or none."
            )
        return camera
    # A start value for the fit.
    focal_px = REFERENCE_FOCAL_PX * width_px / REFERENCE_WIDTH_PX
    guess = centred_camera(width_px, height_px, focal_px, geometry.pose((0.0, 0.0, 0.0)))
    return msgspec.structs.replace(guess, serial=serial, date=date)


def write_pictures(folder: Path, pictures: Sequence[TakenPicture]) -> None:
    """Write pictures and poses in the format of `read_pictures`."""
    rows: list[list[str]] = []
    for number, picture in enumerate(pictures):
        name = f"{number:03d}"
        for side, pixels in (("left", picture.left), ("right", picture.right)):
            if pixels is not None:
                write_picture(folder / f"{side}_{name}.png", pixels)
        T = picture.T_world_tcp
        if T is not None:
            angles = [] if picture.q_rad is None else picture.q_rad.tolist()
            rows.append([name, *(repr(value) for value in (*T.position_m.tolist(), *T.wxyz.tolist(), *angles))])
    if rows:
        joints = len(rows[0]) - len(_HEADER)
        header = [*_HEADER, *(f"q{joint}_rad" for joint in range(1, joints + 1))]
        _write_rows(folder / POSES, [header, *rows])


def _read_poses(path: Path) -> dict[str, tuple[Pose, Float64Array | None]]:
    """Pose of the tool and joint angles by the name of the picture."""
    poses: dict[str, tuple[Pose, Float64Array | None]] = {}
    count, turn = 0, _turn_of(path)
    columns = _PLACE_COLUMNS + len(turn)
    for number, row in _rows(path):
        try:
            name, values = row[0].strip(), np.array([float(value) for value in row[1:]])
            if len(values) < columns or not np.all(np.isfinite(values)):
                raise ValueError(f"{len(values)} numbers")
            if poses and len(values) != count:
                raise ValueError(f"{len(values)} numbers, and {count} in the lines before")
            if name in poses:
                raise ValueError(f"picture {name!r} has a line already")
            count = len(values)
            poses[name] = _pose(values[:columns], turn), values[columns:] if len(values) > columns else None
        except (ValueError, IndexError, BadValue) as error:
            raise InputError(
                f"{path}, line {number}: {error}; each line is NAME,x,y,z,{','.join(turn)} [m], in all lines or none "
                "with the angles of all joints [rad] behind, and the first line is a header; under the headings "
                "rx_rad,ry_rad,rz_rad the turn is a rotation vector [rad], else a quaternion."
            ) from error
    return poses


def _turn_of(path: Path) -> tuple[str, ...]:
    """The columns that give the turn of a pose, by the headings of a file. Raises `InputError` for degrees."""
    headings = [heading.strip().lower() for heading in _lines(path)[0]]
    turn = headings[1 + _PLACE_COLUMNS :][: len(_ROTATION_VECTOR)]
    if turn == [f"{axis}_deg" for axis in _ROTATION_VECTOR]:
        raise InputError(f"{path} has rotation vectors in degrees; write them in radians, under rx_rad,ry_rad,rz_rad.")
    return _ROTATION_VECTOR if [one.removesuffix("_rad") for one in turn] == [*_ROTATION_VECTOR] else _QUATERNION


def _pose(values: Sequence[float] | Float64Array, turn: tuple[str, ...]) -> Pose:
    """The pose of six or seven numbers. Raises `ValueError`, also for a turn that cannot be one."""
    norm = float(np.linalg.norm(values[_PLACE_COLUMNS:]))
    if turn == _ROTATION_VECTOR:
        if len(values) != _PLACE_COLUMNS + len(turn):
            raise BadValue(f"{len(values)} numbers")
        if not norm <= _LONGEST_TURN_RAD:
            raise BadValue(f"the rotation vector has length {norm:.3g}, more than one turn [rad]; is it in degrees?")
        vector = Rotation.from_rotvec(np.asarray(values[_PLACE_COLUMNS:], dtype=np.float64))
        return geometry.pose(values[:3], vector.as_quat(scalar_first=True))
    if not abs(norm - 1.0) <= _NORM_TOLERANCE:
        raise BadValue(f"the quaternion {', '.join(f'{value:g}' for value in values[3:])} has length {norm:.3g}, not 1")
    return geometry.pose(values[:3], values[3:])


def _lines(path: Path) -> list[list[str]]:
    """All lines; an empty file has one without columns."""
    try:
        return list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines())) or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} cannot be read: {error}; save it as CSV in UTF-8.") from error


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """The non-empty lines after the header, each with its number."""
    rows = _lines(path)
    try:
        float(rows[0][-1])
    except (IndexError, ValueError):
        return [(number, row) for number, row in enumerate(rows[1:], start=2) if any(row)]
    raise InputError(f"{path} begins with numbers; the first line must be a header, or a line would be lost.")


def _write_rows(path: Path, rows: Sequence[Sequence[object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)


def _whole(path: Path, number: int, columns: Sequence[str]) -> int:
    """The first of some columns as a stamp [ns]."""
    try:
        return int(columns[0])
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}, line {number}: a stamp in whole nanoseconds is missing ({columns}).") from error


def _read(path: Path) -> UInt8Array:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise InputError(f"{path} is not a picture that can be read; save it as PNG.")
    return np.asarray(picture, dtype=np.uint8)
