"""The SceneScan driver on arrays in the format of visiontransfer; no device was there."""

import asyncio
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_visiontransfer import DeviceInfo, FakeVisiontransfer, ImageSet, ImageType

from dlokit.communication.memory import MemoryTransport
from dlokit.errors import ConfigError, HardwareError
from dlokit.extras.cameras import scenescan
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.extras.cameras.scenescan import LEAST_LATENCY_NS, SceneScanCamera, SceneScanConfig, depth_of
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, write_calibration
from dlokit.geometry import pose
from dlokit.testing import checked_camera
from dlokit.types.image import CameraCalibration, DepthImage

F_PX, BASELINE_M = 1156.16, 0.0998  # of the authors' camera
Q = np.array(
    [[1, 0, 0, -99.5], [0, 1, 0, -29.5], [0, 0, 0, F_PX], [0, 0, 1 / BASELINE_M, 0]],
    dtype=np.float32,
)
Z_M = 1.2
LEFT = np.random.default_rng(0).integers(0, 250, (60, 200), dtype=np.uint8)
DISPARITY = np.full((60, 200), round(16 * F_PX * BASELINE_M / Z_M), dtype=np.uint16)
DISPARITY[0, 0], DISPARITY[5, 9] = 0xFFF, 0
PATIENCE_S = 30.0  # it takes milliseconds; only a failing test waits this long
Installer = Callable[..., FakeVisiontransfer]


def whole(now_ns: int) -> ImageSet:
    return ImageSet({ImageType.IMAGE_LEFT: LEFT, ImageType.IMAGE_DISPARITY: DISPARITY}, Q, now_ns=now_ns)


def left_alone(now_ns: int) -> ImageSet:
    return ImageSet({ImageType.IMAGE_LEFT: LEFT}, Q, now_ns=now_ns)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Installer:
    def install(send: Callable[[int], ImageSet | None], *devices: DeviceInfo) -> FakeVisiontransfer:
        fake = FakeVisiontransfer(send, *devices, latency_s=LEAST_LATENCY_NS / 1e9)
        monkeypatch.setattr(scenescan, "visiontransfer", lambda: fake)
        return fake

    return install


def taken(camera: SceneScanCamera, timeout_s: float = PATIENCE_S) -> DepthImage:
    async def main() -> DepthImage:
        with camera:
            return await camera.capture(timeout_s)

    return asyncio.run(main())


def test_it_keeps_to_its_protocol(installed: Installer):
    last_ns = 0

    def at_100_hz(now_ns: int) -> ImageSet | None:
        nonlocal last_ns
        if now_ns - last_ns < 10_000_000:
            return None
        last_ns = now_ns
        return whole(now_ns)

    fake = installed(at_100_hz)
    assert asyncio.run(checked_camera(SceneScanCamera(clock_ns=fake.clock), captures=3)).captures == 3


def test_disparities_become_depths_in_the_left_picture(installed: Installer):
    fake = installed(whole)
    image = taken(SceneScanCamera(clock_ns=fake.clock))
    np.testing.assert_array_equal(image.pixels, np.repeat(LEFT[..., None], 3, axis=2))
    # Half a step of 1/16 px is 0.4 mm at 1.2 m.
    assert image.depth_m[2, 3] == pytest.approx(Z_M, abs=0.0005)
    assert image.depth_m[0, 0] == image.depth_m[5, 9] == 0.0  # no match, and at infinity
    camera = image.calibration
    assert (camera.fx_px, camera.cx_px, camera.cy_px) == (pytest.approx(F_PX), 99.5, 29.5)
    assert (camera.width_px, camera.height_px, camera.serial) == (200, 60, "N42")
    assert camera.distortion is None


def test_depths_are_what_the_q_matrix_reprojects():
    rng = np.random.default_rng(0)
    steps = rng.integers(1, 0xFFF, (6, 10), dtype=np.uint16)
    angled = Q.astype(np.float64)
    angled[3, 3] = 0.3  # principal points that differ
    for subpixels in (8, 16):
        points = angled @ np.stack([np.zeros(60), np.zeros(60), steps.ravel() / subpixels, np.ones(60)])
        wanted = (points[2] / points[3]).reshape(6, 10)
        np.testing.assert_allclose(depth_of(steps, angled, subpixels), wanted, rtol=1e-5)  # float32


def test_pictures_of_12_bits_and_in_colour_are_taken(installed: Installer):
    disparity = {ImageType.IMAGE_DISPARITY: DISPARITY}
    bits = LEFT.astype(np.uint16) * 16
    fake = installed(lambda now_ns: ImageSet({ImageType.IMAGE_LEFT: bits, **disparity}, Q, now_ns=now_ns))
    np.testing.assert_array_equal(taken(SceneScanCamera(clock_ns=fake.clock)).pixels[..., 0], LEFT)
    colour = np.stack([LEFT, LEFT + 1, LEFT + 2], axis=2)
    fake = installed(lambda now_ns: ImageSet({ImageType.IMAGE_LEFT: colour, **disparity}, Q, now_ns=now_ns))
    np.testing.assert_array_equal(taken(SceneScanCamera(clock_ns=fake.clock)).pixels, colour)


def test_a_picture_that_has_arrived_is_taken_by_a_host_that_was_busy_until_the_time_was_over(installed: Installer):
    fake = installed(whole)
    np.testing.assert_array_equal(taken(SceneScanCamera(clock_ns=fake.clock), timeout_s=0.0).pixels[..., 0], LEFT)


def test_incomplete_image_sets_of_the_start_are_skipped(installed: Installer):
    sent = [left_alone, left_alone]
    fake = installed(lambda now_ns: (sent.pop() if sent else whole)(now_ns))
    assert taken(SceneScanCamera(clock_ns=fake.clock)).depth_m[2, 3] > 0.0
    fake = installed(left_alone)
    with pytest.raises(HardwareError, match="operation mode to stereo matching"):
        taken(SceneScanCamera(clock_ns=fake.clock), 0.1)


def test_stamps_are_of_the_middle_of_the_exposure_on_the_hosts_clock(installed: Installer):
    fake = installed(whole)

    async def main() -> None:
        with SceneScanCamera(clock_ns=fake.clock) as camera:
            for _ in range(3):
                begin_ns = fake.clock()
                assert begin_ns <= (await camera.capture(PATIENCE_S)).stamp_ns <= fake.clock()
            assert camera.clock_offset is not None
            # The device's clock is 100 s ahead, and the stamp half of 8 ms after the exposure's begin.
            assert camera.clock_offset.offset_ns == pytest.approx(-100.004e9, abs=1e4)

    asyncio.run(main())


def test_a_silent_camera_is_named_and_connected_to_again(installed: Installer):
    silent = False
    fake = installed(lambda now_ns: None if silent else whole(now_ns))

    async def main() -> None:
        nonlocal silent
        with SceneScanCamera(clock_ns=fake.clock) as camera:
            await camera.capture(PATIENCE_S)
            silent = True
            begin_ns = fake.clock()
            with pytest.raises(HardwareError, match=r"no picture within 1\.5 s.*connects again"):
                await camera.capture(10.0)
            assert fake.clock() - begin_ns < 2e9
            assert fake.connected == 0
            with pytest.raises(HardwareError, match="no picture"):
                await camera.capture(0.01)
            assert fake.connected == 1  # a short time-out does not disconnect
            silent = False
            await camera.capture(PATIENCE_S)
        with pytest.raises(HardwareError, match="closed"):
            await camera.capture(PATIENCE_S)

    asyncio.run(main())
    assert fake.connected == 0


def test_one_of_several_is_chosen_by_address_or_serial(installed: Installer):
    fake = installed(whole, DeviceInfo("10.0.0.1", "N1"), DeviceInfo("10.0.0.2", "N2"))
    assert taken(SceneScanCamera(address="10.0.0.2", clock_ns=fake.clock)).calibration.serial == "N2"
    assert taken(SceneScanCamera(address="N1", clock_ns=fake.clock)).calibration.serial == "N1"
    for address in ("", "N3"):
        with pytest.raises(HardwareError, match=r"N1 at 10\.0\.0\.1, N2 at 10\.0\.0\.2.*--camera\.address"):
            taken(SceneScanCamera(address=address, clock_ns=fake.clock))


def test_the_pose_is_that_of_the_file(tmp_path: Path, installed: Installer):
    installed(lambda _: whole(time.monotonic_ns()))  # the settings build a camera on the host's clock
    assert taken(SceneScanCamera()).calibration.T_world_camera is OVER_THE_TABLE
    optics = CameraCalibration(
        width_px=1, height_px=1, fx_px=1.0, fy_px=1.0, cx_px=0.0, cy_px=0.0, T_world_camera=pose((0.5, 0.6, 1.0))
    )
    write_calibration(tmp_path / "calibration.toml", optics)
    camera = SceneScanConfig(calibration=str(tmp_path / "calibration.toml")).build(MemoryTransport())
    assert isinstance(camera, SceneScanCamera)
    np.testing.assert_array_equal(taken(camera).calibration.T_world_camera.position_m, [0.5, 0.6, 1.0])


def test_a_calibration_that_cannot_be_is_refused_with_the_camera_and_the_value(installed: Installer):
    for place, value, said in (
        ((2, 3), np.nan, "fx_px is nan"),
        ((3, 2), 0.0, "1 / baseline is 0 per metre"),
        ((3, 2), 1e-3 / BASELINE_M, "1 / baseline is 0.01"),  # in millimetres
        ((0, 3), 1e6, "cx_px is -1e"),
    ):
        wrong = Q.copy()
        wrong[place] = value
        pictures = {ImageType.IMAGE_LEFT: LEFT, ImageType.IMAGE_DISPARITY: DISPARITY}
        fake = installed(lambda now_ns, Q=wrong, of=pictures: ImageSet(of, Q, now_ns=now_ns))
        with pytest.raises(HardwareError, match=rf"SceneScan camera N42 has .*{said}.*calibrate it"):
            taken(SceneScanCamera(clock_ns=fake.clock))


@pytest.mark.parametrize("config", [SceneScanConfig, RealSenseConfig])
def test_a_calibration_of_the_optics_alone_does_not_place_the_camera(
    config: type[SceneScanConfig | RealSenseConfig], tmp_path: Path
):
    file = tmp_path / "calibration.toml"
    optics = CameraCalibration(
        width_px=1, height_px=1, fx_px=1.0, fy_px=1.0, cx_px=0.0, cy_px=0.0, T_world_camera=pose((0.0, 0.0, 0.0))
    )
    write_calibration(file, optics)
    with pytest.raises(ConfigError, match=r"calibration\.toml is of the optics alone .*handeye --intrinsics"):
        config(calibration=str(file)).build(MemoryTransport())


def test_without_the_package_it_says_where_it_comes_from(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "visiontransfer", None)
    with pytest.raises(HardwareError, match=r"nerian\.com.*no registry"):
        SceneScanCamera().__enter__()
