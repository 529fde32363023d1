"""What fixtures show and hide in a picture."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from stereo_scene import calibration, robot_state

from dlokit.description.arm.franka import PANDA
from dlokit.description.installation import Installation
from dlokit.description.scene import Box, Fixture, Post
from dlokit.description.table import TABLE_TOP_M
from dlokit.functional.cell import fixtures as cell_fixtures
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.geometry import resample
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.observer.visibility import shaded
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.fixture_filter import behind_fixtures, entries, fixture_depth_m, with_fixtures
from dlokit.skills.perception.pipeline import perceive
from dlokit.skills.perception.self_filter import occlusion_map, robot_capsules
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.observation import Observation

POST = Post(name="A", position_m=(0.5, 0.0, 0.0), diameter_m=0.02, height_m=0.04)
BOX = Box(name="B", position_m=(0.6, 0.1, 0.0), rpy_deg=(0.0, 0.0, 90.0), size_m=(0.06, 0.02, 0.03))
CONFIG = PerceptionConfig()
NO_ROBOT = robot_capsules(())


def toward_camera(point: Float64Array, distance_m: float) -> Float64Array:
    """A point `distance_m` nearer to the camera, on the same line of sight."""
    eye = calibration().T_world_camera.position_m
    return point + distance_m * (eye - point) / np.linalg.norm(eye - point)


@pytest.mark.parametrize(
    ("fixture", "start", "direction", "depth_m"),
    [
        (POST, (0.5, 0.5, 0.02), (0.0, -1.0, 0.0), 0.49),  # into the side, one radius before the axis
        (POST, (0.5, 0.0, 1.0), (0.0, 0.0, -1.0), 0.96),  # into the top
        (POST, (0.5, 0.5, 0.05), (0.0, -1.0, 0.0), np.inf),  # above it
        (POST, (0.515, 0.5, 0.02), (0.0, -1.0, 0.0), np.inf),  # beside it
        (POST, (0.5, 0.5, 0.02), (0.0, 1.0, 0.0), np.inf),  # away from it
        (BOX, (0.6, 0.5, 0.02), (0.0, -1.0, 0.0), 0.37),  # turned, its long side is along y
        (BOX, (0.5, 0.1, 0.02), (2.0, 0.0, 0.0), 0.045),  # in multiples of the direction
        (BOX, (0.62, 0.5, 0.02), (0.0, -1.0, 0.0), np.inf),
    ],
)
def test_a_ray_enters_a_fixture_at_its_surface(
    fixture: Fixture, start: tuple[float, ...], direction: tuple[float, ...], depth_m: float
):
    assert entries(fixture, np.array(start), np.array([direction]), 0.0)[0] == pytest.approx(depth_m)


def test_a_margin_makes_a_fixture_larger_on_every_side():
    down, across = np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, -1.0, 0.0]])
    for fixture in (POST, BOX):
        x, y, _ = fixture.position_m
        assert entries(fixture, np.array([x, y, 1.0]), down, 0.002)[0] == pytest.approx(1.0 - fixture.top_m - 0.002)
    assert entries(POST, np.array([0.511, 0.5, 0.02]), across, 0.0)[0] == np.inf
    assert entries(POST, np.array([0.511, 0.5, 0.02]), across, 0.002)[0] < 0.5
    assert entries(BOX, np.array([0.611, 0.5, 0.02]), across, 0.002)[0] == pytest.approx(0.5 - 0.1 - 0.03 - 0.002)


def test_points_on_a_fixture_and_behind_it_are_its_own_and_those_in_front_beside_and_above_are_not():
    camera = calibration()
    on_top, on_side = np.array([0.5, 0.0, 0.04]), np.array([0.5, 0.01, 0.02])
    points = np.array(
        [
            on_top,
            on_side,
            toward_camera(on_side, -0.02),  # inside
            [0.5, -0.015, 0.004],  # a rope behind it, which no camera sees through it
            toward_camera(on_side, 0.005),  # the surface of a rope in front of it
            toward_camera(on_top, 0.004),  # of a rope over it
            [0.516, 0.0, 0.004],  # of a rope that touches its side
            [0.484, 0.0, 0.004],
        ]
    )
    assert behind_fixtures(points, (POST,), camera).tolist() == [True, True, True, True, False, False, False, False]


def observation(camera: CameraCalibration, fixtures: tuple[Fixture, ...]) -> Observation:
    occlusion = with_fixtures(occlusion_map(NO_ROBOT, camera, 8), fixtures, camera)
    return Observation(
        stamp_ns=1, points_world=np.zeros((0, 3), dtype=np.float32), calibration=camera, occlusion=occlusion
    )


def test_a_node_behind_a_post_is_hidden_and_one_beside_it_or_in_front_is_not():
    nodes = np.array([[0.5, -0.016, 0.004], [0.5, 0.016, 0.004], [0.475, 0.0, 0.004], [0.525, 0.0, 0.004]])
    assert shaded(nodes, observation(calibration(), (POST,))).tolist() == [True, False, False, False]
    assert not shaded(nodes, observation(calibration(), ())).any()


def test_an_occlusion_map_without_fixtures_stays_the_same_and_with_them_hides_what_the_robot_hides():
    camera = calibration()
    over_table = np.array([-0.1, 0.35, 0.05, -2.2, 0.0, 2.5, 0.8])
    of_robot = occlusion_map(robot_capsules((PosedArm(PANDA, robot_state(over_table)),)), camera, 8)
    assert with_fixtures(of_robot, (), camera) is of_robot
    grid = np.stack(np.meshgrid(np.linspace(0.25, 0.75, 60), np.linspace(-0.3, 0.3, 60)), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.full(len(grid), TABLE_TOP_M)])
    plain = Observation(stamp_ns=1, points_world=points.astype(np.float32), calibration=camera, occlusion=of_robot)
    far = Post(name="far", position_m=(0.3, -0.3, 0.0))
    among = with_fixtures(of_robot, (far,), camera)
    fine = Observation(stamp_ns=1, points_world=points.astype(np.float32), calibration=camera, occlusion=among)
    away = np.linalg.norm(points[:, :2] - [0.3, -0.3], axis=1) > 0.05
    hidden = shaded(points, plain)
    assert hidden.sum() > 100
    assert np.all(shaded(points, fine)[away & hidden])
    # The finer map adds two pixels around the robot at most.
    assert np.count_nonzero(shaded(points, fine)[away] & ~hidden[away]) < 0.2 * hidden.sum()


def test_the_depth_of_a_fixture_is_that_of_its_surface():
    camera = calibration()
    depth_m = fixture_depth_m(POST, camera)
    rows, columns = np.nonzero(np.isfinite(depth_m))
    assert 100 < len(rows) < 600  # 12 px wide and 25 high
    coarse = fixture_depth_m(POST, camera, scale=2)
    assert coarse.shape == (280, 320)
    assert np.count_nonzero(np.isfinite(coarse)) == pytest.approx(len(rows) / 4, rel=0.1)
    assert np.min(depth_m) > np.linalg.norm(camera.T_world_camera.position_m - [0.5, 0.0, 0.02]) * 0.8
    assert np.ptp(depth_m[rows, columns]) < 0.05


def test_a_post_as_bright_as_the_rope_leaves_no_points_and_the_rope_against_it_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(cell_fixtures, "_wood", lambda: np.full((64, 64, 3), 230, dtype=np.uint8))
    posts = (
        Post(name="A", position_m=(0.5, 0.0, 0.0), diameter_m=0.012),
        Post(name="B", position_m=(0.42, 0.1, 0.0), diameter_m=0.02, height_m=0.04),
    )
    # Without errors of the camera: 3 mm of it are more than the margin.
    config = CellConfig(camera_error_m=0.0, camera_error_deg=0.0)
    cell = Cell(config, seed=1, installation=Installation(fixtures=posts))
    cell.place_dlo([[0.511, -0.25], [0.511, 0.25]], settle=False)
    images, robots = cell.capture(), (PosedArm(PANDA, cell.arm_state()),)
    cell.close()
    rope = resample(cell.true_nodes_world(), 500)

    def points(fixtures: tuple[Fixture, ...], images: CameraPictures = images) -> Float64Array:
        look = perceive(images, robots, CONFIG, CONFIG.segmentation, 0.004, fixtures=fixtures)
        return look.observation.points_world.astype(np.float64)

    def off_rope_m(cloud: Float64Array) -> Float64Array:
        return np.asarray(KDTree(rope).query(cloud)[0])

    assert np.count_nonzero(off_rope_m(points(())) > 0.012) > 10  # both posts are seen
    among = points(posts)
    assert np.count_nonzero(off_rope_m(among) > 0.012) <= 1  # where stereo matching errs at the foot of a post
    gaps = np.asarray(KDTree(among).query(rope)[0])
    assert np.max(gaps) < 0.008  # also where it touches the post
