import numpy as np
from stereo_scene import calibration

from dlokit.geometry.camera import plane_disparity
from dlokit.skills.perception.cloud import lonely, thin, to_centre_line
from dlokit.skills.perception.stereo import Disparity, Window, reproject

RNG = np.random.default_rng(0)


def test_the_disparities_of_a_plane_give_its_points_and_unknown_ones_none():
    camera = calibration()
    window = Window(left=300, top=200, right=340, bottom=220)
    v, u = np.mgrid[200:220, 300:340].astype(float)
    pixels = plane_disparity(camera, 0.05).at(u, v).astype(np.float32)
    pixels[3, 4] = np.nan
    points = reproject(Disparity(window=window, pixels=pixels), camera)
    assert len(points) == pixels.size - 1
    # Single-precision disparities of 60 px are good to 4e-6 px, or 0.1 µm.
    np.testing.assert_allclose(points[:, 2], 0.05, atol=1e-6)


def test_downsampling_keeps_coverage_and_the_mean():
    cloud = RNG.uniform(0.0, 0.1, (3000, 3))
    thinned = thin(cloud, 0.01)
    assert len(thinned) <= 10**3 + 300  # cubes that the cloud touches
    distance = np.min(np.linalg.norm(cloud[:, None] - thinned[None], axis=2), axis=1)
    assert distance.max() <= 0.01 * np.sqrt(3)  # the diagonal of a cube


def test_downsampling_gives_each_voxel_the_mean_of_its_points():
    np.testing.assert_allclose(thin(np.array([[0.001, 0, 0], [0.003, 0, 0], [0.05, 0, 0]]), 0.01)[0], [0.002, 0, 0])


def test_no_voxel_keeps_all_points():
    cloud = RNG.uniform(0.0, 0.1, (10, 3))
    assert thin(cloud, 0.0) is cloud


def test_an_isolated_point_is_an_outlier_and_a_cluster_is_not():
    cluster = RNG.normal(0.0, 0.002, (20, 3))
    flags = lonely(np.vstack([cluster, [[0.1, 0.0, 0.0]]]))
    assert flags.tolist() == [False] * 20 + [True]


def test_an_empty_cloud_stays_empty():
    empty = np.zeros((0, 3))
    assert len(thin(empty, 0.01)) == len(lonely(empty)) == 0


def test_lifted_points_move_one_radius_away_from_the_camera():
    camera = calibration()
    points = np.array([[0.5, 0.0, 0.2]])
    moved = to_centre_line(points, camera, 0.004, 0.0)
    eye = camera.T_world_camera.position_m
    assert np.isclose(np.linalg.norm(moved - eye) - np.linalg.norm(points - eye), 0.004)


def test_points_below_the_table_are_lifted_along_their_line_of_sight():
    camera = calibration()
    point = np.array([[0.5, 0.0, -0.006]])
    moved = to_centre_line(point, camera, 0.004, 0.0)[0]
    assert np.isclose(moved[2], 0.004)
    eye = camera.T_world_camera.position_m
    np.testing.assert_allclose(np.cross(moved - eye, point[0] - eye), 0.0, atol=1e-12)


def test_without_a_table_points_keep_their_height():
    camera = calibration()
    assert to_centre_line(np.array([[0.5, 0.0, -0.1]]), camera, 0.004, None)[0, 2] < -0.1
