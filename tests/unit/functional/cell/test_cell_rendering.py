import dataclasses
import threading

import cv2
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.default_cameras import STEREO_BASELINE_M
from dlokit.description.shapes import builtin_shape
from dlokit.errors import DlokitError
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.rendering import StereoRig
from dlokit.functional.cell.world import Cell

EXACT = CellConfig(image_noise_sigma=0.0, camera_error_m=0.0, camera_error_deg=0.0)


@pytest.fixture(scope="module")
def cell():
    result = Cell(EXACT, seed=0)
    result.place_dlo(builtin_shape("I", 0.5, 200))
    yield result
    result.close()


def test_the_believed_camera_is_off_by_3_mm_and_a_fifth_of_a_degree():
    for seed in range(5):
        rig = StereoRig(CellConfig(), seed=seed)
        T_true_believed = geometry.compose(
            geometry.inverse(rig.true_calibration.T_world_camera), rig.calibration.T_world_camera
        )
        assert np.linalg.norm(T_true_believed.position_m) == pytest.approx(0.003)  # rounding only
        turn_deg = np.degrees(2 * np.arccos(min(1.0, T_true_believed.wxyz[0])))
        assert turn_deg == pytest.approx(0.2, rel=1e-4)  # arccos near 1
        assert rig.calibration.fx_px == rig.true_calibration.fx_px


def test_another_seed_gives_another_error():
    a, b = (StereoRig(CellConfig(), seed=seed).calibration.T_world_camera.position_m for seed in (0, 1))
    assert not np.allclose(a, b, atol=1e-5)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_rope_is_seen_at_its_calibrated_position(cell: Cell, side: str):
    images = cell.capture()
    calibration = images.calibration
    bright = getattr(images, side).min(axis=2) > 130
    camera = geometry.transform(geometry.inverse(calibration.T_world_camera), cell.true_nodes_world())
    if side == "right":
        camera[:, 0] -= STEREO_BASELINE_M
    uv = camera[:, :2] / camera[:, 2:] * calibration.fx_px + (calibration.cx_px, calibration.cy_px)
    # The rope is 5 px wide in the image: the centre of the bright pixels in a row of the window is its centre.
    for u, v in uv[5:36:5]:
        row, left = round(v), round(u) - 8
        columns = np.nonzero(bright[row, left : left + 17])[0] + left
        drift = (row - v) * (uv[30, 0] - uv[10, 0]) / (uv[30, 1] - uv[10, 1])  # the rope is straight
        # 1 px: half of it is rounding to pixels, the rest the light from one side.
        assert columns.mean() == pytest.approx(u + drift, abs=1.0)


def test_the_disparity_is_positive_and_fits_the_depth(cell: Cell):
    images = cell.capture()
    calibration = images.calibration
    patch = images.left[270:290, 200:260]
    found = cv2.matchTemplate(images.right[270:290], patch, cv2.TM_CCOEFF_NORMED)
    disparity = 200 - int(found.argmax())
    T = geometry.matrix(calibration.T_world_camera)
    ray = T[:3, :3] @ [
        (229.5 - calibration.cx_px) / calibration.fx_px,
        (279.5 - calibration.cy_px) / calibration.fy_px,
        1,
    ]
    depth_m = -T[2, 3] / ray[2]
    assert disparity == pytest.approx(calibration.fx_px * STEREO_BASELINE_M / depth_m, abs=1.0)  # whole pixels


def test_rendering_does_not_change_the_simulation():
    nodes = []
    for looks in (False, True):
        cell = Cell(EXACT, seed=0)
        cell.place_dlo(builtin_shape("S", 0.5, 200))
        cell.step(0.1)
        if looks:
            cell.capture()
        cell.step(0.1)
        nodes.append(cell.true_nodes_world())
        cell.close()
    assert np.array_equal(*nodes)


def test_noise_is_drawn_from_the_seed_and_differs_between_pictures():
    config = dataclasses.replace(EXACT, image_noise_sigma=2.0, width_px=160, height_px=140)

    def look() -> list[np.ndarray]:
        cell = Cell(config, seed=9)
        pictures = [cell.capture().left for _ in range(2)]
        cell.close()
        return pictures

    first, second = look(), look()
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])
    # Difference of two pictures of one scene: sqrt(2) times sigma; a tenth for rounding and clipping.
    assert (first[0].astype(float) - first[1]).std() == pytest.approx(2.0 * np.sqrt(2), rel=0.1)


def test_pictures_from_another_thread_are_refused(cell: Cell):
    cell.capture()
    errors: list[Exception] = []

    def look() -> None:
        try:
            cell.capture()
        except DlokitError as error:
            errors.append(error)

    thread = threading.Thread(target=look)
    thread.start()
    thread.join(timeout=10)
    assert len(errors) == 1
    assert "thread" in str(errors[0])
