import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.geometry import resample, rotation
from dlokit.geometry.camera import back_project
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.cloud import MOST_PIXELS
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.depth import surface_of_depth
from dlokit.skills.perception.pipeline import corrected_camera_pose, perceive
from dlokit.skills.perception.rectification import rectified
from dlokit.types.image import CameraCalibration, DepthImage

CONFIG = PerceptionConfig()
RADIUS_M = 0.004
CAMERA = CameraCalibration(
    width_px=64,
    height_px=48,
    fx_px=60.0,
    fy_px=60.0,
    cx_px=31.5,
    cy_px=23.5,
    T_world_camera=geometry.pose((0.0, 0.0, 0.0)),  # depth is the world's z
)
CABLE = np.zeros((48, 64), dtype=np.bool_)
CABLE[20:25] = True


def taken(depth_m: NDArray[np.floating], camera: CameraCalibration = CAMERA) -> DepthImage:
    pixels = np.zeros((48, 64, 3), dtype=np.uint8)
    return DepthImage(stamp_ns=0, pixels=pixels, depth_m=depth_m.astype(np.float32), calibration=camera)


def cable_at(depth_m: float, table_m: float = 1.0) -> NDArray[np.float64]:
    return np.where(CABLE, depth_m, table_m)


@pytest.fixture(scope="module")
def cell():
    cell = Cell(CellConfig(camera_error_m=0.0, camera_error_deg=0.0), seed=0)
    cell.place_dlo(builtin_shape("S", 0.5, 200))
    yield cell
    cell.close()


def test_the_points_are_where_the_pixels_of_the_mask_are():
    points = surface_of_depth(taken(cable_at(0.9)), CABLE)
    assert len(points) == np.count_nonzero(CABLE)
    np.testing.assert_allclose(points[:, 2], 0.9, atol=1e-6)  # float32
    assert points[:, 1].min() == pytest.approx((20 - 23.5) * 0.9 / 60.0)


def test_flying_pixels_are_removed():
    depth_m = cable_at(0.9)
    flying = np.random.default_rng(0).random((48, 64)) < 0.2
    depth_m[flying] = 0.95
    points = surface_of_depth(taken(depth_m), CABLE)
    assert len(points) > 0.7 * np.count_nonzero(CABLE)
    np.testing.assert_allclose(points[:, 2], 0.9, atol=1e-6)


def test_the_rim_of_the_mask_where_the_depth_is_of_the_table_is_removed():
    depth_m = cable_at(0.9)
    depth_m[[20, 24]] = 1.0  # the mask is two pixels wider than the depth of the cable
    points = surface_of_depth(taken(depth_m), CABLE)
    assert len(points) > 0
    np.testing.assert_allclose(points[:, 2], 0.9, atol=1e-6)


def test_holes_leave_the_rest():
    depth_m = cable_at(0.9)
    depth_m[:, 20:30] = 0.0
    points = surface_of_depth(taken(depth_m), CABLE)
    assert len(points) == 54 * 5
    np.testing.assert_allclose(points[:, 2], 0.9, atol=1e-6)


def test_an_isolated_pixel_is_noise_and_an_empty_mask_has_no_points():
    depth_m = np.zeros((48, 64))
    depth_m[22, 30] = 0.9
    assert surface_of_depth(taken(depth_m), CABLE).shape == (0, 3)
    assert surface_of_depth(taken(depth_m), np.zeros_like(CABLE)).shape == (0, 3)


def test_a_cable_of_which_no_depth_is_known_shows_no_points():
    assert surface_of_depth(taken(cable_at(0.0)), CABLE).shape == (0, 3)  # black, shiny or too near


def test_of_a_large_mask_pixels_are_used_evenly_up_to_a_number_that_bounds_the_time():
    size = (300, 400)
    camera = msgspec.structs.replace(CAMERA, width_px=400, height_px=300)
    image = DepthImage(
        stamp_ns=0, pixels=np.zeros((*size, 3), np.uint8), depth_m=np.ones(size, np.float32), calibration=camera
    )
    points = surface_of_depth(image, np.ones(size, dtype=np.bool_))
    assert 0.5 * MOST_PIXELS < len(points) <= MOST_PIXELS
    places = back_project(np.array([[0, 0], [399, 299], [200, 150]]), np.ones(3), camera)
    assert KDTree(points).query(places)[0].max() < 3.0 / 60.0  # three pixels


def test_a_lens_moves_depths_without_mixing_them():
    bent = msgspec.structs.replace(CAMERA, distortion=np.array([0.3, 0.0, 0.0, 0.0, 0.0], dtype=np.float32))
    ideal = rectified(taken(cable_at(0.8), bent))
    assert ideal.calibration.distortion is None
    assert set(np.unique(ideal.depth_m)) <= {np.float32(v) for v in (0.0, 0.8, 1.0)}
    assert not np.array_equal(ideal.depth_m, taken(cable_at(0.8)).depth_m)


def test_the_cloud_of_a_depth_camera_lies_on_the_centre_line_and_covers_it(cell: Cell):
    points = perceive(
        cell.capture_depth(), (PosedArm(PANDA, cell.arm_state()),), CONFIG, CONFIG.segmentation, RADIUS_M
    ).observation
    found = points.points_world
    nodes = cell.true_nodes_world()
    off = KDTree(resample(nodes, 2000)).query(found)[0]
    # The noise is 5 mm of depth at 1 m and alike over a centimetre, so that it moves whole pieces of the cloud.
    assert np.median(off) < 0.004
    assert np.percentile(off, 95) < 0.009
    assert np.max(KDTree(found).query(nodes)[0]) < 0.012
    assert points.occlusion is not None
    assert points.calibration is not None


def test_the_depth_of_the_table_corrects_height_and_tilt_of_the_believed_pose():
    cell = Cell(CellConfig(), seed=5)
    image = cell.capture_depth()
    pose = corrected_camera_pose(image, (PosedArm(PANDA, cell.arm_state()),), CONFIG, CONFIG.segmentation)
    true, believed = cell.depth_rig.true_calibration.T_world_camera, image.calibration.T_world_camera
    cell.close()
    assert pose is not None
    assert abs(pose.position_m[2] - true.position_m[2]) < 0.001
    off, before = (np.arccos(min(1.0, rotation(of)[2] @ rotation(true)[2])) for of in (pose, believed))
    assert off < min(np.radians(0.08), before)


def test_a_pose_far_off_and_a_picture_without_a_plane_are_not_corrected(cell: Cell):
    image, robots = cell.capture_depth(), (PosedArm(PANDA, cell.arm_state()),)
    T = image.calibration.T_world_camera
    moved = geometry.pose(T.position_m + np.array([0.0, 0.0, 0.1]), T.wxyz)
    far = msgspec.structs.replace(image.calibration, T_world_camera=moved)
    unknown = msgspec.structs.replace(image, depth_m=np.zeros_like(image.depth_m))
    wild = np.random.default_rng(0).uniform(0.5, 2.0, image.depth_m.shape).astype(np.float32)
    for bad in (
        msgspec.structs.replace(image, calibration=far),
        unknown,
        msgspec.structs.replace(image, depth_m=wild),
    ):
        assert corrected_camera_pose(bad, robots, CONFIG, CONFIG.segmentation) is None
