"""The RealSense driver through librealsense itself, on files as its recorder writes them."""

import asyncio
import contextlib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from cable_pictures import CAMERA, picture
from numpy.typing import NDArray
from realsense_recording import record

from dlokit.app.commands import execute
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import HardwareError, NoMorePictures
from dlokit.extras.cameras.realsense import RealSenseCamera, RealSenseConfig
from dlokit.extras.checks.command import camera_args, run
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, write_calibration
from dlokit.types.image import DepthImage

rs = pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed: pip install '.[realsense]'")

FRAMES = 12
PATIENCE_S = 60.0  # it takes milliseconds; only a failing test waits this long
SHIFTS_M = [0.002 * number for number in range(FRAMES)]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("realsense") / "cable.db3"
    record(rs, path, [picture(shift) for shift in SHIFTS_M])
    return path


def taken(camera: RealSenseCamera, count: int) -> list[DepthImage]:
    async def main() -> list[DepthImage]:
        with camera:
            return [await camera.capture(PATIENCE_S) for _ in range(count)]

    return asyncio.run(main())


def steps(image: DepthImage) -> NDArray[np.uint16]:
    """Depths in the steps of the camera, 1 mm."""
    return np.round(image.depth_m * 1000.0).astype(np.uint16)


def test_a_file_gives_its_pictures_in_order_with_depth_in_metres(file: Path):
    images = taken(RealSenseCamera(file=file), FRAMES - 1)  # the recorder may drop one
    wanted = {one.pixels.tobytes(): one for one in map(picture, SHIFTS_M)}
    for image in images:
        assert image.pixels.shape == (480, 640, 3)
        assert image.depth_m.dtype == np.float32
        np.testing.assert_allclose(image.depth_m, steps(image) / 1000.0, atol=1e-6)  # float32
        sent = wanted.pop(image.pixels.tobytes())
        # Aligning takes the nearest of the neighbours that fall on a pixel.
        known = (image.depth_m > 0.0) & (sent.depth_m > 0.0)
        assert np.mean(known) > 0.9
        assert np.mean(np.abs(image.depth_m - sent.depth_m)[known] < 0.005) > 0.97
    stamps_ns = [image.stamp_ns for image in images]
    assert np.median(np.diff(stamps_ns)) == pytest.approx(1e9 / 30, rel=1e-3)
    assert stamps_ns == sorted(set(stamps_ns))


def test_the_calibration_is_the_devices_and_the_pose_that_of_the_file(file: Path, tmp_path: Path):
    camera = RealSenseCamera(file=file)
    with pytest.raises(HardwareError, match="enter it before"):
        _ = camera.calibration
    with camera:
        assert (camera.calibration.fx_px, camera.calibration.cx_px) == (CAMERA.fx_px, CAMERA.cx_px)
        assert camera.calibration.serial == "0042"
        assert camera.calibration.distortion is None
        assert camera.calibration.T_world_camera is OVER_THE_TABLE
    write_calibration(tmp_path / "calibration.toml", CAMERA)
    config = RealSenseConfig(file=str(file), calibration=str(tmp_path / "calibration.toml"))
    with config.build(MemoryTransport()) as built:
        np.testing.assert_array_equal(built.calibration.T_world_camera.position_m, CAMERA.T_world_camera.position_m)


def test_depth_is_aligned_to_the_colour_picture(tmp_path: Path):
    image = picture(0.0, noise_m=0.0)
    record(rs, tmp_path / "beside.db3", [image] * 6, depth_from_colour_m=0.05)
    (seen,) = taken(RealSenseCamera(file=tmp_path / "beside.db3"), 1)
    row = 150  # above the hole
    was, now = (np.flatnonzero(steps(one)[row] == 792) for one in (image, seen))
    assert now.mean() - was.mean() == pytest.approx(0.05 * CAMERA.fx_px / 0.792, abs=1.0)  # whole pixels


def test_a_file_ends_and_is_played_again_after_opening(file: Path):
    camera = RealSenseCamera(file=file)

    async def main() -> tuple[list[DepthImage], DepthImage]:
        with camera:
            images = [await camera.capture(PATIENCE_S) for _ in range(FRAMES - 1)]
            with contextlib.suppress(NoMorePictures):  # the recorder may drop one
                images.append(await camera.capture(PATIENCE_S))
            with pytest.raises(NoMorePictures, match="have been played"):
                await camera.capture(PATIENCE_S)
        with pytest.raises(HardwareError, match="closed"):
            await camera.capture(PATIENCE_S)
        with camera:
            return images, await camera.capture(PATIENCE_S)

    images, again = asyncio.run(main())
    assert FRAMES - 1 <= len(images) <= FRAMES
    assert again.stamp_ns > images[-1].stamp_ns
    np.testing.assert_array_equal(again.pixels, images[0].pixels)


def test_without_a_device_or_with_a_file_of_something_else_it_says_so(tmp_path: Path):
    with pytest.raises(HardwareError, match=r"cannot be started.*USB 3.*rs-enumerate-devices"):
        RealSenseCamera(serial="000000000000").__enter__()
    (tmp_path / "text.db3").write_text("text")
    with pytest.raises(HardwareError, match=r"cannot be started.*that librealsense recorded"):
        RealSenseCamera(file=tmp_path / "text.db3").__enter__()


def test_the_command_checks_a_realsense_file_through_librealsense(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    record(rs, tmp_path / "cable.db3", [picture(0.001 * number) for number in range(8)])

    assert run(camera_args(["realsense", "--camera.file", str(tmp_path / "cable.db3"), "--captures", "3"])) == 0, (
        capsys.readouterr()
    )

    (report,) = tmp_path.rglob("report.md")
    text = report.read_text()
    assert "| pictures | DepthImage, 640 x 480 px |" in text
    assert "| serial | 0042 |" in text
    assert "| depth | at " in text
    assert f"| pyrealsense2 | {version('pyrealsense2')} |" in text


def test_one_command_follows_a_file_of_librealsense(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    record(rs, tmp_path / "cable.db3", [picture(shift) for shift in SHIFTS_M[:10]])
    arguments = ["track", "--camera", "realsense", "--camera.file", str(tmp_path / "cable.db3"), "--headless"]
    assert execute(arguments) == 0
    said = capsys.readouterr().out
    assert "10 of 10 frames followed" in said or "9 of 9 frames followed" in said  # the recorder may drop one
