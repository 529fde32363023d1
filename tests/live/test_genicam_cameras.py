"""The GenICam driver on aravis's fake cameras, each a process."""

import asyncio
import re
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
from genicam_cameras import ADDRESSES, OPTICS, SERIALS, SIZE_PX, FakeCameras, two_cameras, why_not

from dlokit.errors import HardwareError
from dlokit.extras.calibration.commands.pictures import uncalibrated
from dlokit.extras.cameras.genicam import MOST_SKEW_NS, GenicamConfig, GenicamPair
from dlokit.functional.cameras.base import Camera
from dlokit.testing import checked_camera
from dlokit.types.image import StereoImages

PATIENCE_S = 60.0
"""A camera is back by then: calls to the one that was gone end after up to 7 s, searching takes 1 s."""


@pytest.fixture(scope="module")
def fakes() -> None:
    if reason := why_not():
        pytest.skip(reason)


@pytest.fixture
def cameras(fakes: None) -> Iterator[FakeCameras]:
    with two_cameras() as running:
        yield running


async def pair_of(camera: Camera) -> StereoImages:
    """A pair; on a busy computer a fake camera may be too late for one, which the driver then opens again."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            pair = await camera.capture(2.0)
        except HardwareError:
            assert time.monotonic() < end_s
        else:
            assert isinstance(pair, StereoImages)
            return pair


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


def test_a_lost_camera_is_named_long_before_the_time_is_over_and_goes_on_when_it_is_back(cameras: FakeCameras):
    async def main() -> None:
        with GenicamPair(*SERIALS, OPTICS) as camera:
            await pair_of(camera)
            cameras.kill(1)
            begin = time.monotonic()
            with pytest.raises(HardwareError, match=r"the right GenICam camera GV02 is lost.*cable"):
                await camera.capture(10.0 * PATIENCE_S)
            assert time.monotonic() - begin < PATIENCE_S  # 1.5 s on a computer with time, whatever the time-out
            with pytest.raises(HardwareError, match="right GenICam camera GV02"):
                await camera.capture(1.0)
            cameras.start(1)
            for _ in range(2):
                await pair_of(camera)

    asyncio.run(main())


def test_pairs_exposed_far_apart_are_refused(cameras: FakeCameras):
    async def main() -> None:
        with GenicamPair(*SERIALS, OPTICS, most_skew_ns=-1) as camera:
            end_s, said = time.monotonic() + PATIENCE_S, ""
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


def test_cameras_that_are_not_calibrated_give_pairs_with_a_guess_of_their_optics(cameras: FakeCameras):
    with uncalibrated(GenicamConfig(left=SERIALS[0], right=SERIALS[1])) as camera:
        taken = asyncio.run(pair_of(camera))
    assert (taken.calibration.width_px, taken.calibration.height_px) == SIZE_PX
    assert taken.calibration.serial == "+".join(SERIALS)
