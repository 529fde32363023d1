"""The RealSense driver: librealsense's own pipeline on recorded files, and a scripted one for what files cannot do."""

import asyncio
import contextlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cable_pictures import CAMERA, picture
from numpy.typing import NDArray
from realsense_recording import record

from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, HardwareError, NoMorePictures
from dlokit.functional.cameras import realsense
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, write_calibration
from dlokit.functional.cameras.realsense import RealSenseCamera, RealSenseConfig
from dlokit.types.image import DepthImage

FRAMES = 12
PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long
SHIFTS_M = [0.002 * number for number in range(FRAMES)]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rs = pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed: pip install 'dlokit[realsense]'")
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
    rs = pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed: pip install 'dlokit[realsense]'")
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


def test_what_is_missing_is_named_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ConfigError, match=r"--camera\.file .*nothing\.db3 does not exist"):
        RealSenseConfig(file=str(tmp_path / "nothing.db3")).build(MemoryTransport())
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(HardwareError, match=r"dlokit\[realsense\].*libusb-1\.0-0"):
        RealSenseCamera().__enter__()


def test_without_a_device_or_with_a_file_of_something_else_it_says_so(tmp_path: Path):
    pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed: pip install 'dlokit[realsense]'")
    with pytest.raises(HardwareError, match=r"cannot be started.*USB 3.*rs-enumerate-devices"):
        RealSenseCamera(serial="000000000000").__enter__()
    (tmp_path / "text.db3").write_text("text")
    with pytest.raises(HardwareError, match=r"cannot be started.*that librealsense recorded"):
        RealSenseCamera(file=tmp_path / "text.db3").__enter__()


class Script:
    """Stands for pyrealsense2 with one device, whose pipelines give what the test says."""

    def __init__(self, *turns: list[Callable[[], Any] | None]) -> None:
        """`turns`: for each start of a pipeline what it gives, a None being a wait without a picture."""
        self.turns = list(turns)
        self.started = self.stopped = 0
        self.format = SimpleNamespace(z16=0, rgb8=1)
        self.stream = SimpleNamespace(depth=0, color=1)
        self.camera_info = SimpleNamespace(serial_number=0)
        self.playback_status = SimpleNamespace(stopped="stopped")
        self.distortion = SimpleNamespace(none=0, inverse_brown_conrady=2)
        self.frame_metadata_value = SimpleNamespace(sensor_timestamp=0, frame_timestamp=1, actual_exposure=2)
        self.lens = SimpleNamespace(
            width=4, height=3, fx=5.0, fy=5.0, ppx=1.5, ppy=1.0, model=2, coeffs=[0.1, 0.0, 0.0, 0.0, 0.0]
        )

    def config(self) -> Any:
        return SimpleNamespace(
            enable_device=lambda serial: None,
            enable_stream=lambda *what: None,
            enable_device_from_file=lambda path, repeat: None,
            resolve=lambda pipeline: self.get_active_profile(),
        )

    def pipeline_wrapper(self, pipeline: "Script") -> "Script":
        return pipeline

    def get_active_profile(self) -> Any:
        """The profile of a file that has not ended."""
        playback = SimpleNamespace(set_real_time=lambda real_time: None, current_status=lambda: "playing")
        return SimpleNamespace(get_device=lambda: SimpleNamespace(as_playback=lambda: playback))

    def align(self, stream: int) -> Any:
        return SimpleNamespace(process=lambda frames: frames)

    def pipeline(self) -> "Script":
        return self

    def start(self, config: Any) -> Any:
        if not self.turns:
            raise RuntimeError("No device connected")
        self.started += 1
        self.waiting = self.turns.pop(0)
        stream = SimpleNamespace(as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: self.lens))
        sensor = SimpleNamespace(is_depth_sensor=lambda: True)
        sensor.as_depth_sensor = lambda: SimpleNamespace(get_depth_scale=lambda: 0.001)
        device = SimpleNamespace(query_sensors=lambda: [sensor], get_info=lambda what: "0042")
        return SimpleNamespace(get_device=lambda: device, get_stream=lambda kind: stream)

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, Any]:
        given = self.waiting.pop(0) if self.waiting else None
        if given is None:
            time.sleep(timeout_ms / 1000.0)
            return False, None
        return True, given()

    def stop(self) -> None:
        self.stopped += 1


def frameset(*, depth: bool = True, age_ms: float = 0.0, exposure_us: int | None = None) -> Callable[[], Any]:
    """Frames whose device clock is the host's, `age_ms` late."""

    def now() -> Any:
        frame = SimpleNamespace(
            get_timestamp=lambda: time.monotonic_ns() / 1e6 - age_ms,
            supports_frame_metadata=lambda what: what == 2 and exposure_us is not None,
            get_frame_metadata=lambda what: exposure_us,
            get_data=lambda: np.full((3, 4, 3), 7, dtype=np.uint8),
        )
        deep = SimpleNamespace(get_data=lambda: np.full((3, 4), 812, dtype=np.uint16))
        return SimpleNamespace(get_color_frame=lambda: frame, get_depth_frame=lambda: deep if depth else None)

    return now


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Script]:
    def make(*turns: list[Callable[[], Any] | None]) -> Script:
        script = Script(*turns)
        monkeypatch.setattr(realsense, "librealsense", lambda: script)
        monkeypatch.setattr(realsense, "LOST_S", 0.05)
        monkeypatch.setattr(realsense, "LEAST_LATENCY_NS", 0)
        return script

    return make


def test_incomplete_framesets_of_the_start_are_skipped(scripted: Callable[..., Script]):
    scripted([frameset(depth=False), frameset(depth=False), frameset()])
    (image,) = taken(RealSenseCamera(), 1)
    np.testing.assert_allclose(image.depth_m, np.full((3, 4), 0.812), atol=1e-6)  # float32


def test_a_lost_camera_is_named_and_its_return_needs_a_pipeline_of_its_own(scripted: Callable[..., Script]):
    script = scripted([frameset()], [frameset(), frameset()])

    async def main() -> None:
        with RealSenseCamera() as camera:
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match=r"no picture within 0\.1 s; is its cable in"):
                await camera.capture(0.1)
            assert (script.started, script.stopped) == (1, 1)
            await camera.capture(PATIENCE_S)  # it is back
            assert script.started == 2
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match="no picture"):
                await camera.capture(0.1)
            with pytest.raises(HardwareError, match="No device connected"):
                await camera.capture(0.1)

    asyncio.run(main())


def test_a_short_time_out_does_not_start_a_working_camera_again(
    scripted: Callable[..., Script], monkeypatch: pytest.MonkeyPatch
):
    script = scripted([frameset()])
    monkeypatch.setattr(realsense, "LOST_S", PATIENCE_S)

    async def main() -> None:
        with RealSenseCamera() as camera:
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match="no picture"):
                await camera.capture(0.001)
            script.waiting.append(frameset())
            await camera.capture(PATIENCE_S)

    asyncio.run(main())
    assert script.started == 1


def test_a_file_that_plays_late_has_not_ended(
    scripted: Callable[..., Script], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    scripted([None, None, frameset()])
    monkeypatch.setattr(realsense, "_FILE_WAIT_S", 0.01)
    (tmp_path / "cable.db3").touch()
    (image,) = taken(RealSenseCamera(file=tmp_path / "cable.db3"), 1)
    assert image.depth_m[0, 0] == pytest.approx(0.812)


def test_stamps_are_of_the_middle_of_the_exposure_on_the_hosts_clock(scripted: Callable[..., Script]):
    scripted([frameset(exposure_us=8000, age_ms=-20.0), frameset(exposure_us=8000, age_ms=-20.0)])

    async def main() -> None:
        with RealSenseCamera() as camera:
            begin_ns = time.monotonic_ns()
            image = await camera.capture(PATIENCE_S)
            # The clock cannot know how late a picture comes, but not later than it was taken.
            assert begin_ns <= image.stamp_ns <= time.monotonic_ns()
            assert camera.clock_offset is not None
            assert camera.clock_offset.offset_ns == pytest.approx(-16e6, abs=3e6)  # half of the exposure is before
            assert camera.clock_offset.uncertainty_ns >= 0

    asyncio.run(main())


def test_a_lens_of_the_inverse_model_is_turned_around(scripted: Callable[..., Script]):
    scripted([frameset()])
    with RealSenseCamera() as camera:
        np.testing.assert_array_equal(camera.calibration.distortion, np.array([-0.1, 0, 0, 0, 0], dtype=np.float32))
