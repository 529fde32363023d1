"""Every requirement of `check_camera` is violated once on purpose, and named."""

import asyncio
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import msgspec
import numpy as np
import pytest

from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.geometry import pose
from dlokit.testing import CheckFailed, check_camera
from dlokit.testing.__main__ import CameraCheckArgs, run
from dlokit.testing.cameras import WANTED
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages

replace = msgspec.structs.replace
CALIBRATION = CameraCalibration(
    width_px=32,
    height_px=24,
    fx_px=30.0,
    fy_px=30.0,
    cx_px=15.5,
    cy_px=11.5,
    baseline_m=0.1,
    T_world_camera=pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),
    serial="42",
)
PIXELS = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)


class FlawedCamera:
    """A camera on the host's clock, with one flaw."""

    def __init__(self, flaw: str = "", *, depth: bool = False) -> None:
        self._flaw = flaw
        self._depth = depth
        self._open = False

    @property
    def calibration(self) -> CameraCalibration:
        return replace(CALIBRATION, cx_px=99.0) if self._flaw == "calibration" else CALIBRATION

    async def capture(self, timeout_s: float) -> StereoImages | DepthImage:
        if not self._open and self._flaw != "closes":
            raise HardwareError("the camera is closed")
        if self._flaw == "opens":
            raise RuntimeError("no device")
        if timeout_s < 0.01:
            if self._flaw == "time-out":
                await asyncio.sleep(0.8)
            raise HardwareError("no picture in time")
        stamp_ns = {"stamps": 7, "exposed after the call": time.monotonic_ns() - 10**9}.get(
            self._flaw, time.monotonic_ns()
        )
        pixels = {"pictures": PIXELS[:20], "contrast": np.full_like(PIXELS, 8)}.get(self._flaw, PIXELS)
        if self._depth:
            depth_m = np.full((24, 32), 900.0 if self._flaw == "depth" else 0.9, dtype=np.float32)
            depth_m[0] = 0.0
            return DepthImage(stamp_ns=stamp_ns, pixels=pixels, depth_m=depth_m, calibration=self.calibration)
        return StereoImages(stamp_ns=stamp_ns, left=pixels, right=PIXELS, calibration=self.calibration)

    def __enter__(self) -> Self:
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False


@pytest.mark.parametrize("depth", [False, True])
def test_a_sound_camera_passes_every_check(depth: bool) -> None:
    report = check_camera(FlawedCamera(depth=depth), captures=3, clock_ns=time.monotonic_ns)
    assert report.passed == tuple(WANTED)
    assert report.kind == ("DepthImage" if depth else "StereoImages")
    assert "32 x 24, serial 42: 9 checks passed" in str(report)
    assert ("depth at 96% of the pixels" in str(report)) is depth


@pytest.mark.parametrize("flaw", WANTED)
def test_a_camera_that_violates_a_requirement_fails_by_its_name(flaw: str) -> None:
    clock: Any = None if flaw == "stamps" else time.monotonic_ns
    with pytest.raises(CheckFailed, match=rf"failed: {flaw}\b"):
        check_camera(FlawedCamera(flaw, depth=flaw == "depth"), captures=3, clock_ns=clock)


def test_the_command_checks_a_folder_of_recorded_pairs_and_a_function(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_calibration(tmp_path / "calibration.toml", CALIBRATION)
    for side in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{side}_0.png"), PIXELS)
    assert run(CameraCheckArgs(camera=str(tmp_path), captures=3)) == 0
    assert run(CameraCheckArgs(camera="test_check_camera:FlawedCamera", captures=3)) == 0
    assert capsys.readouterr().out.count("9 checks passed") == 2
    with pytest.raises(ConfigError, match="neither a folder nor"):
        run(CameraCheckArgs(camera="webcam"))
    with pytest.raises(ConfigError, match="at least 2"):
        run(CameraCheckArgs(camera=str(tmp_path), captures=1))
