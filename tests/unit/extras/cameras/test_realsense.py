"""The RealSense driver on scripted pipelines, for what files cannot do; tests/live plays files with librealsense."""

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_clock import HandClock

from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.cameras import realsense
from dlokit.extras.cameras.realsense import LEAST_LATENCY_NS, LOST_S, RealSenseCamera, RealSenseConfig
from dlokit.types.image import DepthImage

PATIENCE_S = 30.0
"""On the clock of the script."""


def taken(camera: RealSenseCamera, count: int) -> list[DepthImage]:
    async def main() -> list[DepthImage]:
        with camera:
            return [await camera.capture(PATIENCE_S) for _ in range(count)]

    return asyncio.run(main())


def test_what_is_missing_is_named_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ConfigError, match=r"--camera\.file .*nothing\.db3 does not exist"):
        RealSenseConfig(file=str(tmp_path / "nothing.db3")).build(MemoryTransport())
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(HardwareError, match=r"\[realsense\].*libusb-1\.0-0"):
        RealSenseCamera().__enter__()


LATENCY_S = LEAST_LATENCY_NS / 1e9
Frames = Callable[[HandClock], Any]


class Script:
    """Stands for pyrealsense2 with one device, whose pipelines give what the test says, on a clock of its own."""

    def __init__(self, *turns: list[Frames | None]) -> None:
        """`turns`: for each start of a pipeline what it gives, a None being a wait without a picture."""
        self.clock = HandClock()
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

    def context(self) -> Any:
        """The one device need not be told from others."""
        return SimpleNamespace(query_devices=list)

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
        device = SimpleNamespace(
            query_sensors=lambda: [sensor], supports=lambda what: True, get_info=lambda what: "0042"
        )
        return SimpleNamespace(get_device=lambda: device, get_stream=lambda kind: stream)

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, Any]:
        given = self.waiting.pop(0) if self.waiting else None
        if given is None:
            self.clock.advance(timeout_ms / 1000.0)
            return False, None
        frames = given(self.clock)
        self.clock.advance(LATENCY_S)
        return True, frames

    def stop(self) -> None:
        self.stopped += 1


def frameset(*, depth: bool = True, behind_ms: float = 0.0, exposure_us: int | None = None) -> Frames:
    """Frames that are exposed when they are asked for, by a device whose clock is `behind_ms` behind the host's."""

    def now(clock: HandClock) -> Any:
        taken_ms = clock() / 1e6 - behind_ms
        frame = SimpleNamespace(
            get_timestamp=lambda: taken_ms,
            supports_frame_metadata=lambda what: what == 2 and exposure_us is not None,
            get_frame_metadata=lambda what: exposure_us,
            get_data=lambda: np.full((3, 4, 3), 7, dtype=np.uint8),
        )
        deep = SimpleNamespace(get_data=lambda: np.full((3, 4), 812, dtype=np.uint16))
        return SimpleNamespace(get_color_frame=lambda: frame, get_depth_frame=lambda: deep if depth else None)

    return now


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Script]:
    def make(*turns: list[Frames | None]) -> Script:
        script = Script(*turns)
        monkeypatch.setattr(realsense, "librealsense", lambda: script)
        return script

    return make


def test_incomplete_framesets_of_the_start_are_skipped(scripted: Callable[..., Script]):
    script = scripted([frameset(depth=False), frameset(depth=False), frameset()])
    (image,) = taken(RealSenseCamera(clock_ns=script.clock), 1)
    np.testing.assert_allclose(image.depth_m, np.full((3, 4), 0.812), atol=1e-6)  # float32


def test_a_lost_camera_is_named_and_its_return_needs_a_pipeline_of_its_own(scripted: Callable[..., Script]):
    script = scripted([frameset()], [frameset(), frameset()])

    async def main() -> None:
        with RealSenseCamera(clock_ns=script.clock) as camera:
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match=r"no picture within 0\.6 s; is its cable in"):
                await camera.capture(0.6)
            assert (script.started, script.stopped) == (1, 1)
            await camera.capture(PATIENCE_S)  # it is back
            assert script.started == 2
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match="no picture"):
                await camera.capture(0.6)
            with pytest.raises(HardwareError, match="No device connected"):
                await camera.capture(0.6)

    asyncio.run(main())


def test_a_short_time_out_does_not_start_a_working_camera_again(scripted: Callable[..., Script]):
    script = scripted([frameset()])

    async def main() -> None:
        with RealSenseCamera(clock_ns=script.clock) as camera:
            await camera.capture(PATIENCE_S)
            with pytest.raises(HardwareError, match="no picture"):
                await camera.capture(LOST_S - 0.1)
            script.waiting.append(frameset())
            await camera.capture(PATIENCE_S)

    asyncio.run(main())
    assert script.started == 1


def test_a_file_that_plays_late_has_not_ended(scripted: Callable[..., Script], tmp_path: Path):
    script = scripted([None, None, frameset()])
    (tmp_path / "cable.db3").touch()
    (image,) = taken(RealSenseCamera(file=tmp_path / "cable.db3", clock_ns=script.clock), 1)
    assert image.depth_m[0, 0] == pytest.approx(0.812)


def test_stamps_are_of_the_middle_of_the_exposure_on_the_hosts_clock(scripted: Callable[..., Script]):
    script = scripted([frameset(exposure_us=8000, behind_ms=-20.0)])

    async def main() -> None:
        with RealSenseCamera(clock_ns=script.clock) as camera:
            begin_ns = script.clock()
            image = await camera.capture(PATIENCE_S)
            # The clock cannot know how late a picture comes, but not later than it was taken.
            assert begin_ns <= image.stamp_ns <= script.clock()
            assert camera.clock_offset is not None
            assert camera.clock_offset.offset_ns == pytest.approx(-16e6, abs=1e3)  # half of the exposure is before
            assert camera.clock_offset.uncertainty_ns == LEAST_LATENCY_NS / 2

    asyncio.run(main())


def test_a_lens_of_the_inverse_model_is_turned_around(scripted: Callable[..., Script]):
    scripted([frameset()])
    with RealSenseCamera() as camera:
        np.testing.assert_array_equal(camera.calibration.distortion, np.array([-0.1, 0, 0, 0, 0], dtype=np.float32))
