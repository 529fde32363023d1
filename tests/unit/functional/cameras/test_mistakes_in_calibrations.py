"""Mistakes that people make in the values of a calibration file, a row each: it is refused by key, or read the same."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError
from dlokit.functional.cameras.calibration_file import read_calibration, write_calibration
from dlokit.functional.cell.lens import separate_cameras
from dlokit.types.image import CameraCalibration

CAMERA = default_calibration(640, 480)
SAME = ""
"""The file is read, and what it says of the camera stays."""


def key(name: str, text: str) -> Callable[[str], str]:
    """The file says `text` for a key of its first table."""

    def change(file: str) -> str:
        lines = [line for line in file.splitlines() if not line.startswith(f"{name} =")]
        return "\n".join([f"{name} = {text}", *lines])

    return change


def within(table: str, name: str, text: str) -> Callable[[str], str]:
    """The file says `text` for a key of another table."""

    def change(file: str) -> str:
        before, after = file.split(f"[{table}]\n")
        lines = after.splitlines()
        begin = next(number for number, line in enumerate(lines) if line.startswith(f"{name} ="))
        end = begin + 1 if lines[begin].endswith("]") or "[" not in lines[begin] else lines.index("]", begin) + 1
        return f"{before}[{table}]\n" + "\n".join([*lines[:begin], f"{name} = {text}", *lines[end:]])

    return change


def everyof(*changes: Callable[[str], str]) -> Callable[[str], str]:
    def change(file: str) -> str:
        for one in changes:
            file = one(file)
        return file

    return change


SINGLE: list[tuple[str, Callable[[str], str], str]] = [
    ("focal length in millimetres", everyof(key("fx_px", "4.0"), key("fy_px", "4.0")), "fx_px is 4"),
    ("focal length infinite", key("fy_px", "inf"), "fy_px is inf"),
    ("a digit of one focal length lost", key("fy_px", "58.0"), "fy_px is 58"),
    ("all of K over the width", everyof(*(key(name, "0.9") for name in ("fx_px", "fy_px"))), "fx_px is 0.9"),
    ("centre of the sensor, not of the crop", key("cy_px", "1944.0"), "cy_px is 1944"),
    ("sign of the centre", key("cx_px", "-960.0"), "cx_px is -960"),
    ("centre is no number", key("cy_px", "nan"), "cy_px is nan"),
    ("centre of a crop beside it", key("cx_px", "-20.0"), SAME),
    ("width 0", key("width_px", "0"), "width_px is 0"),
    ("height upside down", key("height_px", "-480"), "height_px is -480"),
    ("baseline in millimetres", key("baseline_m", "120.0"), "baseline_m is 120"),
    ("baseline as OpenCV's T[0]", key("baseline_m", "-0.12"), "baseline_m is -0.12"),
    ("baseline 0", key("baseline_m", "0.0"), "baseline_m is 0"),
    ("stamps late in milliseconds", key("stamps_late_s", "80.0"), "stamps_late_s is 80"),
    ("stamps late is no number", key("stamps_late_s", "nan"), "stamps_late_s is nan"),
    ("six coefficients", key("distortion", "[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]"), "distortion is [0.1"),
    ("coefficients in a row of a matrix", key("distortion", "[[0.1, 0.0, 0.0, 0.0, 0.0]]"), "distortion is [[0.1"),
    (
        "a coefficient of the right lens infinite",
        key("distortion_right", "[inf, 0.0, 0.0, 0.0, 0.0]"),
        "distortion_right",
    ),
    ("eight coefficients, as of ROS's rational_polynomial", key("distortion", "[0.1, 0, 0, 0, 0, 0.2, 0, 0]"), SAME),
    ("twelve coefficients", key("distortion", "[0.1, 0, 0, 0, 0, 0.2, 0, 0, 0, 0, 0, 0]"), SAME),
    ("position is no number", within("T_world_camera", "position_m", "[0.5, nan, 1.0]"), "position_m"),
    (
        "position in millimetres of a far corner",
        within("T_world_camera", "position_m", "[1200.0, -30.0, 900.0]"),
        "T_world_camera",
    ),
    ("position of two numbers", within("T_world_camera", "position_m", "[0.5, 1.0]"), "T_world_camera"),
    ("a rotation vector for the quaternion", within("T_world_camera", "wxyz", "[3.14, 0.0, 0.0, 0.0]"), "wxyz"),
    ("angles for the quaternion", within("T_world_camera", "wxyz", "[180.0, 0.0, 90.0]"), "T_world_camera"),
]

SEPARATE: list[tuple[str, Callable[[str], str], str]] = [
    ("focal length of the raw camera 0", within("raw_right", "fx_px", "0.0"), "raw_right"),
    ("centre of the raw camera far outside", within("raw_left", "cx_px", "3000.0"), "raw_left"),
    (
        "coefficient of the raw camera is no number",
        within("raw_left", "distortion", "[nan, 0.0, 0.0, 0.0, 0.0]"),
        "raw_left",
    ),
    ("seven coefficients of the raw camera", within("raw_left", "distortion", "[0.1, 0, 0, 0, 0, 0, 0]"), "raw_left"),
    ("turn of the raw camera is no number", within("raw_right", "wxyz", "[nan, 0.0, 0.0, 0.0]"), "raw_right"),
    ("turn of the raw camera by half", within("raw_right", "wxyz", "[0.0, 0.0, 0.0, 1.0]"), "raw_right"),
    (
        "a pair that must be rectified, and no baseline",
        lambda file: file.replace("baseline_m", "# baseline_m"),
        "baseline_m",
    ),
]


@pytest.mark.parametrize(
    ("camera", "change", "words"),
    [
        pytest.param(camera, *row[1:], id=row[0])
        for camera, rows in ((CAMERA, SINGLE), (separate_cameras(CAMERA), SEPARATE))
        for row in rows
    ],
)
def test_a_mistake_in_a_calibration_is_named_by_file_and_key(
    camera: CameraCalibration, change: Callable[[str], str], words: str, tmp_path: Path
):
    file = tmp_path / "calibration.toml"
    write_calibration(file, camera)
    before = read_calibration(file)
    file.write_text(change(file.read_text()))
    if words == SAME:
        after = read_calibration(file)
        assert (after.width_px, after.fx_px, after.baseline_m) == (before.width_px, before.fx_px, before.baseline_m)
        np.testing.assert_array_equal(after.T_world_camera.wxyz, before.T_world_camera.wxyz)
        return
    with pytest.raises(ConfigError) as refused:
        read_calibration(file)
    assert words in str(refused.value)
    assert str(file) in str(refused.value)
