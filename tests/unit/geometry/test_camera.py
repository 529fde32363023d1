import numpy as np
import pytest
from stereo_scene import calibration, camera_pose

from dlokit.errors import BadValue, ConfigError
from dlokit.geometry import pose
from dlokit.geometry.camera import back_project, baseline_m, camera_matrix, intrinsics, plane_disparity, project

POINTS = np.random.default_rng(0).uniform([0.2, -0.4, 0.0], [0.9, 0.4, 0.3], (200, 3))


def test_projecting_and_reprojecting_gives_the_same_points():
    camera = calibration()
    seen = project(POINTS, camera)
    # Rounding of doubles at distances of a metre.
    np.testing.assert_allclose(back_project(seen.pixels, seen.depth_m, camera), POINTS, atol=1e-12)


def test_the_optical_axis_meets_the_principal_point():
    camera = calibration()
    ahead = camera.T_world_camera.position_m + 1.2 * np.array(
        [0.0470, -0.5174, -0.8544]
    )  # third row of the published matrix, rounded to four digits
    np.testing.assert_allclose(project(ahead[None], camera).pixels[0], [319.5, 279.5], atol=0.1)


def test_a_point_behind_the_camera_has_no_positive_depth():
    behind = camera_pose().position_m + np.array([0.0, 0.5, 0.5])
    assert project(behind[None], calibration()).depth_m[0] < 0.0


@pytest.mark.parametrize("height_m", [0.0, 0.15])
def test_the_disparity_of_a_plane_is_that_of_its_points(height_m: float):
    camera = calibration()
    on_plane = np.column_stack([POINTS[:, :2], np.full(len(POINTS), height_m)])
    seen = project(on_plane, camera)
    expected = camera.fx_px * baseline_m(camera) / seen.depth_m
    found = plane_disparity(camera, height_m).at(seen.pixels[:, 0], seen.pixels[:, 1])
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_camera_below_the_table_is_refused_with_a_reason():
    with pytest.raises(ConfigError, match="above"):
        plane_disparity(calibration(pose((0.5, 0.0, -0.2))), 0.0)


K = camera_matrix(500.0, 510.0, 320.0, 240.0)


def test_a_camera_matrix_gives_its_intrinsics_back():
    assert intrinsics(K) == (500.0, 510.0, 320.0, 240.0)


@pytest.mark.parametrize("wrong", [K.T, K / 500.0, K + np.eye(3, k=1), np.diag([500.0, 510.0, 0.0])])
def test_a_camera_matrix_that_is_transposed_scaled_or_skewed_is_refused(wrong: np.ndarray):
    with pytest.raises(BadValue, match=r"it must be \[\[fx, 0, cx\]"):
        intrinsics(wrong)
