"""The GenICam driver on aravis's fake cameras, and its settings."""

import asyncio
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from genicam_cameras import ADDRESSES, SERIALS, SIZE_PX, FakeCameras, two_cameras, why_not

from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras import genicam
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, write_calibration
from dlokit.functional.cameras.genicam import MOST_SKEW_NS, GenicamConfig, GenicamPair
from dlokit.geometry import pose
from dlokit.testing import checked_camera
from dlokit.types.image import CameraCalibration, StereoImages

OPTICS = CameraCalibration(
    width_px=SIZE_PX[0],
    height_px=SIZE_PX[1],
    fx_px=600.0,
    fy_px=600.0,
    cx_px=255.5,
    cy_px=255.5,
    baseline_m=0.1,
    T_world_camera=pose((0.4, 0.0, 1.2), (0.0, 1.0, 0.0, 0.0)),
)
SLOW_S = 20.0
"""Within this a camera is back: calls to the one that was gone end after up to 7 s, searching takes 1 s."""


@pytest.fixture(scope="module")
def fakes() -> None:
    if reason := why_not():
        pytest.skip(reason)


@pytest.fixture
def cameras(fakes: None) -> Iterator[FakeCameras]:
    with two_cameras() as running:
        yield running


async def pair_of(camera: GenicamPair) -> StereoImages:
    """A pair; on a busy computer a fake camera may be too late for one, which the driver then opens again."""
    end_s = time.monotonic() + SLOW_S
    while True:
        try:
            return await camera.capture(2.0)
        except HardwareError:
            assert time.monotonic() < end_s


def test_it_keeps_to_its_protocol(cameras: FakeCameras):
    checked = asyncio.run(checked_camera(GenicamPair(*SERIALS, OPTICS), captures=10))
    assert checked.captures == 10


def test_pairs_are_exposed_after_the_call_and_together(cameras: FakeCameras):
    async def main() -> None:
        with GenicamPair(*ADDRESSES, OPTICS) as camera:
            pair = await pair_of(camera)
            for _ in range(20):
                begin_ns = time.monotonic_ns()
                pair = await pair_of(camera)
                assert begin_ns <= pair.stamp_ns <= time.monotonic_ns()
                assert abs(camera.skew_ns) <= MOST_SKEW_NS
            assert pair.left.shape == pair.right.shape == (*SIZE_PX[::-1], 3)
            assert np.ptp(pair.left) > 0  # the fakes show a gradient
            assert all(0 < offset.uncertainty_ns < 20e6 for offset in camera.clock_offsets)
            assert camera.calibration.serial == pair.calibration.serial == "GV01+GV02"

    asyncio.run(main())


def test_stamps_are_of_the_middle_of_the_exposure(cameras: FakeCameras):
    async def main() -> None:
        with GenicamPair(*SERIALS, OPTICS, exposure_s=0.1) as camera:
            for _ in range(5):
                begin_ns = time.monotonic_ns()
                assert (await pair_of(camera)).stamp_ns >= begin_ns + 50e6  # exposure begins after the trigger

    asyncio.run(main())


def test_a_lost_camera_is_named_within_two_seconds_and_goes_on_when_it_is_back(cameras: FakeCameras):
    async def main() -> None:
        with GenicamPair(*SERIALS, OPTICS) as camera:
            await pair_of(camera)
            cameras.kill(1)
            begin = time.monotonic()
            with pytest.raises(HardwareError, match=r"the right GenICam camera GV02 is lost.*cable"):
                await camera.capture(10.0)
            assert time.monotonic() - begin < 5.0  # 1.5 s on a computer with time, whatever the time-out
            with pytest.raises(HardwareError, match="right GenICam camera GV02"):
                await camera.capture(1.0)
            cameras.start(1)
            for _ in range(2):
                await pair_of(camera)

    asyncio.run(main())


def test_pairs_exposed_far_apart_are_refused(cameras: FakeCameras, monkeypatch: pytest.MonkeyPatch):
    async def main() -> None:
        with GenicamPair(*SERIALS, OPTICS) as camera:
            await pair_of(camera)
            monkeypatch.setattr(genicam, "MOST_SKEW_NS", -1)
            end_s, said = time.monotonic() + SLOW_S, ""
            while not re.search(r"no pair within 0\.5 s \(\d+ pairs were exposed more than", said):
                assert time.monotonic() < end_s  # on a busy computer there may be none within 0.5 s
                with pytest.raises(HardwareError) as raised:
                    await camera.capture(0.5)
                said = str(raised.value)

    asyncio.run(main())


def test_other_cameras_than_calibrated_are_refused(cameras: FakeCameras):
    def opened(**changed: Any) -> None:
        GenicamPair(*SERIALS, msgspec.structs.replace(OPTICS, **changed), file="rig.toml").__enter__()

    with pytest.raises(HardwareError, match=r"rig\.toml is of the camera 'GV02\+GV01', this one is 'GV01\+GV02'"):
        opened(serial="GV02+GV01")
    with pytest.raises(HardwareError, match="512 by 512 px"):
        opened(width_px=640)
    with pytest.raises(HardwareError, match=r"left GenICam camera GV09 is not among .*GV01 at 127\.0\.0\.1"):
        GenicamPair("GV09", "GV02", OPTICS).__enter__()
    with pytest.raises(HardwareError, match=r"1e\+06 ms is set.*--camera\.exposure-ms"):
        GenicamPair(*SERIALS, OPTICS, exposure_s=1000.0).__enter__()


def test_a_pair_needs_two_names_and_its_optics(tmp_path: Path):
    file = tmp_path / "calibration.toml"

    def built(left: str = "a", right: str = "b", calibration: str = str(file), exposure_ms: float = 10.0) -> Any:
        config = GenicamConfig(left=left, right=right, calibration=calibration, exposure_ms=exposure_ms)
        return config.build(MemoryTransport())

    with pytest.raises(ConfigError, match=r"--camera\.left.*dlokit doctor"):
        built(right="a")
    with pytest.raises(ConfigError, match=r"--camera\.calibration.*dlokit calibrate stereo"):
        built(calibration="")
    write_calibration(file, msgspec.structs.replace(OPTICS, baseline_m=None))
    with pytest.raises(ConfigError, match="of a single camera"):
        built()
    write_calibration(file, OPTICS)
    with pytest.raises(ConfigError, match=r"--camera\.exposure-ms is 0"):
        built(exposure_ms=0.0)
    assert built().calibration.T_world_camera.position_m[2] == 1.2
    write_calibration(file, msgspec.structs.replace(OPTICS, T_world_camera=pose((0.0, 0.0, 0.0))))
    assert built().calibration.T_world_camera is OVER_THE_TABLE


def test_without_aravis_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "gi", None)
    monkeypatch.setattr(genicam, "_SYSTEM_PACKAGES", Path("/nowhere"))
    with pytest.raises(HardwareError, match=r"apt install gir1\.2-aravis-0\.8 python3-gi"):
        GenicamPair("a", "b", OPTICS).__enter__()
