import numpy as np
import pytest
from stereo_scene import calibration

from dlokit.geometry.camera import project
from dlokit.skills.perception.cloud import inside_box
from dlokit.skills.perception.config import BoxConfig
from dlokit.skills.perception.self_filter import box_outline

BOX = BoxConfig(lower_world=(0.3, -0.2, 0.0), upper_world=(0.7, 0.2, 0.1))


def test_the_faces_belong_to_the_box():
    corners = np.array([BOX.lower_world, BOX.upper_world])
    assert inside_box(corners, BOX).all()
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-9
        assert not inside_box(corners + np.array([-step, step]), BOX).any()


def test_every_point_of_the_box_is_in_its_outline():
    camera = calibration()
    points = np.random.default_rng(0).uniform(BOX.lower_world, BOX.upper_world, (500, 3))
    u, v = np.round(project(points, camera).pixels).astype(int).T
    assert box_outline(BOX, camera)[v, u].all()


def test_a_point_beside_the_box_is_not_in_its_outline():
    camera = calibration()
    u, v = np.round(project(np.array([[0.5, -0.35, 0.0]]), camera).pixels[0]).astype(int)
    assert not box_outline(BOX, camera)[v, u]


def test_a_box_around_the_camera_hides_nothing():
    assert box_outline(BoxConfig(lower_world=(0, -1, 0), upper_world=(2, 2, 2)), calibration()).all()


def test_a_box_with_exchanged_bounds_is_refused():
    with pytest.raises(ValueError, match="smaller"):
        BoxConfig(lower_world=(0.5, 0.0, 0.0), upper_world=(0.4, 1.0, 1.0))
