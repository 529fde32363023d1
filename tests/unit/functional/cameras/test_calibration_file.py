import asyncio
from pathlib import Path
from types import TracebackType

import msgspec
import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    MeasuredTable,
    check_same_camera,
    read_calibration,
    read_part,
    write_calibration,
)
from dlokit.functional.cameras.corrected import CalibratedCamera
from dlokit.functional.cell.lens import separate_cameras
from dlokit.types.image import CameraCalibration, StereoImages

CAMERA = default_calibration(64, 64)
RESIDUAL = CalibrationResidual(method="made up", pictures=9, rms_px=0.1, held_out_m=0.001, print_scale=1.002)


class OneColourCamera:
    """A camera whose pictures are grey."""

    def __init__(self) -> None:
        self.is_open = False

    @property
    def calibration(self) -> CameraCalibration:
        return CAMERA

    async def capture(self, timeout_s: float) -> StereoImages:
        grey = np.full((64, 64, 3), 90, dtype=np.uint8)
        return StereoImages(stamp_ns=1, left=grey, right=grey, calibration=CAMERA)

    def __enter__(self) -> "OneColourCamera":
        self.is_open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.is_open = False


def of(**changes: object) -> CameraCalibration:
    return msgspec.structs.replace(CAMERA, **changes)


def test_residual_and_table_stand_beside_the_calibration(tmp_path: Path):
    file = tmp_path / "calibration.toml"
    table = MeasuredTable(height_m=0.001, tilt_x_deg=0.1, tilt_y_deg=-0.1, residual_m=1e-4)
    write_calibration(file, CAMERA, RESIDUAL, table)
    found = read_part(file, CalibrationResidual)
    assert found is not None
    assert msgspec.structs.astuple(found) == msgspec.structs.astuple(RESIDUAL)
    assert read_calibration(file).serial == "simulated"
    assert "height_m = 0.001" in file.read_text()
    write_calibration(file, CAMERA)
    assert read_part(file, CalibrationResidual) is None


def test_two_cameras_that_are_not_parallel_are_written_and_read_and_half_a_pair_is_refused(tmp_path: Path):
    file = tmp_path / "calibration.toml"
    written = separate_cameras(CAMERA)
    write_calibration(file, written)
    read = read_calibration(file)
    for one, other in ((written.raw_left, read.raw_left), (written.raw_right, read.raw_right)):
        assert one is not None
        assert other is not None
        assert (one.fx_px, one.cy_px) == (other.fx_px, other.cy_px)
        np.testing.assert_array_equal(one.wxyz, other.wxyz)
        np.testing.assert_array_equal(one.distortion, other.distortion)
    text = file.read_text()
    file.write_text(text[: text.index("[raw_right]")])
    with pytest.raises(ConfigError, match="raw_left or raw_right alone"):
        read_calibration(file)


def test_a_damaged_residual_is_refused(tmp_path: Path):
    file = tmp_path / "calibration.toml"
    write_calibration(file, CAMERA, RESIDUAL)
    file.write_text(file.read_text().replace("pictures = 9", 'pictures = "many"'))
    with pytest.raises(ConfigError, match="residual"):
        read_part(file, CalibrationResidual)


def test_another_serial_and_another_size_are_refused():
    check_same_camera("file", CAMERA, CAMERA)
    check_same_camera("file", of(serial=""), CAMERA)  # written by hand
    with pytest.raises(ConfigError, match="'7F2A', this one is 'simulated'"):
        check_same_camera("file", of(serial="7F2A"), CAMERA)
    with pytest.raises(ConfigError, match=r"'7F2A', and this one reports no serial number.*remove the line"):
        check_same_camera("file", of(serial="7F2A"), of(serial=""))
    with pytest.raises(ConfigError, match="128 by 64 px"):
        check_same_camera("file", of(width_px=128), CAMERA)


def test_pictures_come_with_the_calibration_of_the_file():
    inner = OneColourCamera()
    wanted = of(fx_px=700.0)
    camera: Camera = CalibratedCamera(inner, wanted, "file")
    with camera:
        assert inner.is_open
        images = asyncio.run(camera.capture(1.0))
    assert not inner.is_open
    assert images.calibration is camera.calibration is wanted


def test_pictures_of_another_camera_are_refused():
    camera = CalibratedCamera(OneColourCamera(), of(serial="7F2A"), "file")
    with pytest.raises(HardwareError, match="7F2A"):
        asyncio.run(camera.capture(1.0))


def test_a_latency_of_the_file_is_taken_off_the_stamps(tmp_path: Path):
    late = msgspec.structs.replace(CAMERA, stamps_late_s=0.08)
    write_calibration(tmp_path / "calibration.toml", late)
    camera = CalibratedCamera(OneColourCamera(), read_calibration(tmp_path / "calibration.toml"), "calibration.toml")
    assert asyncio.run(camera.capture(1.0)).stamp_ns == 1 - 80_000_000
