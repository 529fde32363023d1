import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from dlokit.description.default_cameras import d435_calibration
from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.depth_rendering import (
    BASELINE_M,
    DISPARITY_NOISE_PX,
    INFRARED_FOCAL_PX,
    LEFT_IMAGER_M,
    DepthRig,
    measured,
)
from dlokit.functional.cell.world import Cell
from dlokit.geometry.camera import back_project
from dlokit.types.image import DepthImage

EXACT = CellConfig(image_noise_sigma=0.0, camera_error_m=0.0, camera_error_deg=0.0)
FOCAL_PX = d435_calibration().fx_px
NEAR, FAR = slice(300, 400), slice(420, 640)
"""Columns of a strip in front, and of the wall to the right of it."""


@pytest.fixture(scope="module")
def image():
    cell = Cell(EXACT, seed=0)
    cell.place_dlo(builtin_shape("I", 0.5, 200))
    yield cell.capture_depth()
    cell.close()


def strip(near_m: float = 0.8, far_m: float = 1.0) -> NDArray[np.float32]:
    """True depths of a wall with a strip in front of it."""
    depth_m = np.full((480, 640), far_m, dtype=np.float32)
    depth_m[:, NEAR] = near_m
    return depth_m


def seen(true_m: NDArray[np.float32], noise_px: float = 0.0) -> NDArray[np.float32]:
    noise = np.full(true_m.shape, noise_px, dtype=np.float32)
    return measured(true_m, FOCAL_PX, noise, np.random.default_rng(0))


def test_the_table_is_at_height_0_within_the_noise_of_the_disparity(image: DepthImage):
    camera = image.calibration
    rows, columns = (part.ravel() for part in np.mgrid[300:400:10, 100:300:10])
    heights = back_project(np.column_stack([columns, rows]), image.depth_m[rows, columns], camera)[:, 2]
    depth_m = float(np.median(image.depth_m[300:400, 100:300]))
    sigma_m = depth_m**2 * DISPARITY_NOISE_PX / (INFRARED_FOCAL_PX * BASELINE_M)
    assert abs(np.mean(heights)) < sigma_m / 3  # some 50 independent patches
    assert np.std(heights) == pytest.approx(sigma_m, rel=0.3)  # seen at 30 degrees, and few patches


def test_colour_and_depth_have_one_size_and_depths_are_whole_millimetres(image: DepthImage):
    assert image.pixels.shape == (480, 640, 3)
    assert image.depth_m.shape == (480, 640)
    assert image.depth_m.dtype == np.float32
    steps = image.depth_m.astype(np.float64) * 1000.0
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)  # float32


def test_what_an_imager_does_not_see_has_no_depth():
    depth_m = seen(strip())
    band = FOCAL_PX * (LEFT_IMAGER_M + BASELINE_M) * (1 / 0.8 - 1 / 1.0)  # to the left of the strip, 10 px wide
    unknown = np.flatnonzero(depth_m[240] == 0.0)
    assert len(unknown) == pytest.approx(band, abs=1.5)
    assert NEAR.start - band - 1 < unknown.min() <= unknown.max() < NEAR.start


def test_the_nearer_surface_is_wider_than_it_is_and_pixels_fly_at_its_edge():
    depth_m = seen(strip())
    beside = depth_m[:, NEAR.stop : NEAR.stop + 3]
    assert np.mean(np.isclose(beside, 0.8)) > 0.5
    flying = (beside > 0.805) & (beside < 0.995)
    assert 0.1 < np.mean(flying) < 0.4
    np.testing.assert_array_equal(depth_m[:, FAR], np.float32(1.0))


def test_an_inclined_surface_has_neither_edges_nor_holes():
    slope = np.linspace(1.2, 0.8, 480, dtype=np.float32)[:, None].repeat(640, axis=1)
    np.testing.assert_allclose(seen(slope), slope, atol=0.0006)  # steps of a millimetre


def test_an_error_of_the_disparity_moves_the_depth_by_its_square():
    shift_m = float(seen(np.full((480, 640), 1.0, dtype=np.float32), noise_px=0.1)[0, 0]) - 1.0
    assert shift_m == pytest.approx(-0.1 / (INFRARED_FOCAL_PX * BASELINE_M), abs=0.0006)


def test_neighbouring_pixels_err_alike(image: DepthImage):
    cell = Cell(EXACT, seed=0)
    other = cell.capture_depth(), cell.capture_depth()
    cell.close()
    change = (other[1].depth_m - other[0].depth_m)[300:440, 100:300].astype(np.float64)
    beside = np.mean(change[:, 1:] * change[:, :-1]) / np.mean(change**2)
    far = np.mean(change[:, 30:] * change[:, :-30]) / np.mean(change**2)
    assert beside > 0.9
    assert abs(far) < 0.3


def test_a_seed_repeats_noise_and_the_error_of_the_believed_pose():
    def look(seed: int) -> DepthImage:
        cell = Cell(dataclasses.replace(EXACT, camera_error_m=0.003), seed=seed)
        image = cell.capture_depth()
        cell.close()
        return image

    one, same, other = look(3), look(3), look(4)
    assert one.depth_m.tobytes() == same.depth_m.tobytes()
    assert one.depth_m.tobytes() != other.depth_m.tobytes()
    true = DepthRig(EXACT, seed=3).true_calibration.T_world_camera.position_m
    assert np.linalg.norm(one.calibration.T_world_camera.position_m - true) == pytest.approx(0.003)
