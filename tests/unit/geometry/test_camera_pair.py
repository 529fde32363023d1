import cv2
import msgspec
import numpy as np
import pytest
from board_pictures import lens_camera, separate_camera, taken_pixels, workspace_points

from dlokit.errors import BadValue
from dlokit.geometry.camera import SIDES, SeparateCamera, camera_alone, camera_matrix, project, rectified_pair
from dlokit.skills.perception.rectification import maps_of
from dlokit.types.image import CameraCalibration

SEPARATE = separate_camera()


@pytest.mark.parametrize("camera", [lens_camera(), SEPARATE], ids=["lenses", "separate"])
def test_the_maps_lead_from_a_rectified_pixel_to_where_the_camera_shows_the_same_point(camera: CameraCalibration):
    points = workspace_points()
    for side in SIDES:
        ideal = project(points, camera).pixels
        ideal[:, 0] -= side * camera.fx_px * (camera.baseline_m or 0.0) / project(points, camera).depth_m
        maps = maps_of(camera, side)
        assert maps is not None
        u, v = ideal[None].astype(np.float32).transpose(2, 0, 1)
        at = [cv2.remap(part, u, v, cv2.INTER_LINEAR)[0] for part in maps]
        # 0.05 px: remap interpolates at 1/32 px.
        np.testing.assert_allclose(np.column_stack(at), taken_pixels(points, camera, side), atol=0.05)


def test_a_parallel_pair_of_pinholes_needs_no_maps():
    camera = msgspec.structs.replace(lens_camera(), distortion=None, distortion_right=None)
    assert [maps_of(camera, side) for side in SIDES] == [None, None]


def test_the_rectified_frame_has_the_centres_of_both_cameras_on_its_x_axis():
    left, right = (camera_alone(SEPARATE, side).T_world_camera.position_m for side in SIDES)
    np.testing.assert_allclose(left, SEPARATE.T_world_camera.position_m)
    assert np.linalg.norm(right - left) == pytest.approx(SEPARATE.baseline_m)
    assert np.linalg.norm(right - left) == pytest.approx(np.linalg.norm([0.102, 0.004, -0.003]))


def test_both_pictures_keep_most_of_what_the_cameras_see():
    for side in SIDES:
        maps = maps_of(SEPARATE, side)
        assert maps is not None
        within = (maps[0] >= 0) & (maps[0] <= SEPARATE.width_px - 1)
        within &= (maps[1] >= 0) & (maps[1] <= SEPARATE.height_px - 1)
        assert within.mean() > 0.9


def test_a_camera_that_is_not_on_the_right_is_refused():
    one = SeparateCamera(K=camera_matrix(700.0, 700.0, 320.0, 280.0), distortion=np.zeros(5, dtype=np.float32))
    T = np.eye(4)
    for place in ((0.1, 0.0, 0.0), (-0.05, 0.1, 0.0)):
        T[:3, 3] = place
        with pytest.raises(BadValue, match="exchange the two"):
            rectified_pair(lens_camera(), one, one, T)


def test_raw_cameras_come_in_pairs_and_have_the_distortion():
    with pytest.raises(BadValue, match="alone"):
        msgspec.structs.replace(SEPARATE, raw_right=None)
    with pytest.raises(BadValue, match="distortion"):
        msgspec.structs.replace(SEPARATE, distortion=np.zeros(5, dtype=np.float32))
