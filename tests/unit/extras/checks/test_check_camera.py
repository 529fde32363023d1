"""Every requirement of `check_camera` is violated once on purpose, and named."""

import asyncio
import re
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import cv2
import msgspec
import numpy as np
import pytest

from dlokit.communication.timing import virtual_time
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.cameras.genicam import GenicamConfig
from dlokit.extras.checks.cameras import WANTED
from dlokit.extras.checks.command import CameraCheckArgs, camera_args, run
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.functional.cameras.recorded import RecordedCamera
from dlokit.geometry import pose
from dlokit.testing import CheckFailed, check_camera, checked_camera
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
        return replace(CALIBRATION, cx_px=40.0) if self._flaw == "calibration" else CALIBRATION

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
    camera = FlawedCamera(flaw, depth=flaw == "depth")
    with pytest.raises(CheckFailed, match=rf"failed: {flaw}\b"):
        virtual_time.run(checked_camera(camera, captures=3, clock_ns=clock))


def _report_of(said: str) -> Path:
    return Path(said.rpartition("attach to a bug report: ")[2].strip())


def test_the_command_checks_a_folder_of_recorded_pairs_and_a_function(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_calibration(tmp_path / "calibration.toml", CALIBRATION)
    for side in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{side}_0.png"), PIXELS)
    assert run(CameraCheckArgs(name=str(tmp_path), captures=3)) == 0
    assert "8 checks passed; not tried: exposed after the call" in capsys.readouterr().out
    assert run(CameraCheckArgs(name="test_check_camera:FlawedCamera", captures=3)) == 0
    assert "9 checks passed" in capsys.readouterr().out
    with pytest.raises(ConfigError, match=r"neither an installed camera \(simulated, .*realsense"):
        run(CameraCheckArgs(name="webcam"))
    with pytest.raises(ConfigError, match="no device: it sees the simulated cell"):
        run(CameraCheckArgs(name="simulated"))
    with pytest.raises(ConfigError, match="at least 2"):
        run(CameraCheckArgs(name=str(tmp_path), captures=1))


def test_the_report_has_device_timing_checks_and_versions_and_pictures_that_can_be_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["dlokit.testing", "camera", "a:b"])

    assert run(CameraCheckArgs(name="test_check_camera:FlawedCamera", captures=3)) == 0

    path = _report_of(capsys.readouterr().out)
    text = path.read_text()
    assert "# Check of a camera: passed 9 checks" in text
    assert "python -m dlokit.testing camera a:b" in text
    assert "| serial | 42 |" in text
    assert re.search(r"\| a capture \| p50 .* ms of 3 \|", text)
    assert "| from the stamp to the arrival | p50 " in text
    assert f"| time-out | passed | {WANTED['time-out']} |" in text
    assert f"| dlokit | {version('dlokit')} |" in text
    with RecordedCamera(path.parent) as camera:
        played = asyncio.run(camera.capture(1.0))
    assert isinstance(played, StereoImages)
    assert np.array_equal(played.left, PIXELS)


@pytest.mark.parametrize(
    ("flaw", "row"),
    [
        ("opens", "| opens | **failed**; after 0 captures: RuntimeError: no device |"),
        ("stamps", "| stamps | **failed**; stamps are [7, 7, 7] |"),
    ],
)
def test_a_camera_that_fails_gets_a_report_as_well(
    flaw: str, row: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("test_check_camera.FlawedCamera", partial(FlawedCamera, flaw))

    assert run(CameraCheckArgs(name="test_check_camera:FlawedCamera", captures=3, host_clock=False)) == 1

    text = _report_of(capsys.readouterr().out).read_text()
    assert f"FAILED: {flaw}" in text
    assert row in text
    assert ("| stamps | not tried |" in text) is (flaw == "opens")


def test_the_command_line_takes_the_settings_of_the_camera_that_it_names() -> None:
    args = camera_args(["genicam", "--camera.left", "GV01", "--camera.exposure-ms", "5"])

    assert args.camera == GenicamConfig(left="GV01", exposure_ms=5.0)
