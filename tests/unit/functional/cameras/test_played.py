"""The camera of a replay: each observation gets its recorded images at the recorded time."""

import asyncio

import numpy as np
import pytest

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import HardwareError
from dlokit.functional.cameras.recorded import PlayedCamera, RecordedLook
from dlokit.types.image import CameraCalibration, StereoImages
from dlokit.types.pose import Pose

CALIBRATION = CameraCalibration(
    width_px=2, height_px=1, fx_px=1.0, fy_px=1.0, cx_px=1.0, cy_px=0.5, baseline_m=0.1,
    T_world_camera=Pose(position_m=np.zeros(3), wxyz=np.array([1.0, 0.0, 0.0, 0.0])),
)  # fmt: skip


def pair(stamp_ns: int) -> RecordedLook:
    pixels = np.full((1, 2, 3), stamp_ns % 251, dtype=np.uint8)
    images = StereoImages(stamp_ns=stamp_ns, left=pixels, right=pixels, calibration=CALIBRATION)
    return RecordedLook(log_ns=stamp_ns + 5, images=images)


def looks(camera: PlayedCamera, count: int) -> list[tuple[int, int, int]]:
    """For each observation: time of arrival of its images, their stamp, and their content."""
    seen: list[tuple[int, int, int]] = []

    async def main() -> None:
        with camera:
            for _ in range(count):
                images = await camera.capture(1.0)
                assert isinstance(images, StereoImages)
                seen.append((LoopClock().now_ns(), images.stamp_ns, int(images.left[0, 0, 0])))

    virtual_time.run(main())
    return seen


def test_an_observation_gets_its_own_images_at_their_time() -> None:
    camera = PlayedCamera(iter([pair(10), pair(30)]), [(10, 17), (30, 37)])
    assert looks(camera, 2) == [(15, 10, 10), (35, 30, 30)]
    assert camera.left_out == set()


def test_an_observation_without_images_gets_the_previous_ones_with_its_stamp_and_is_noted() -> None:
    camera = PlayedCamera(iter([pair(10), pair(30)]), [(10, 17), (20, 27), (30, 37)])
    assert looks(camera, 3) == [(15, 10, 10), (27, 20, 10), (35, 30, 30)]
    assert camera.left_out == {20}


def test_images_of_no_observation_are_skipped() -> None:
    assert looks(PlayedCamera(iter([pair(10), pair(20), pair(30)]), [(10, 17), (30, 37)]), 2)[1] == (35, 30, 30)


def test_without_images_there_is_no_observation() -> None:
    camera = PlayedCamera(iter([]), [(10, 17)])
    assert camera.empty
    with pytest.raises(HardwareError, match="no pictures"):
        looks(camera, 1)
    with pytest.raises(HardwareError, match="no pictures"):
        _ = camera.calibration


def test_after_the_last_observation_there_are_no_images() -> None:
    async def main() -> None:
        camera = PlayedCamera(iter([pair(10)]), [])
        async with asyncio.timeout(3.0):
            await camera.capture(1.0)

    with pytest.raises(TimeoutError):
        virtual_time.run(main())
