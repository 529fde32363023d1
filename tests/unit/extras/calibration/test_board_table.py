import numpy as np
import pytest
from board_pictures import BOARD, lens_camera, view
from scipy.spatial.transform import Rotation

from dlokit.errors import SkillFailure
from dlokit.extras.calibration.board_table import TablePlane, table_plane
from dlokit.extras.calibration.stereo_rig import BoardShot

CAMERA = lens_camera()
THICKNESS_M = 0.004


def measured(tilt: Rotation, height_m: float, scale: float = 1.0, lifted_m: float = 0.0) -> TablePlane:
    """What is found of a table that is turned about the world's origin, with the board in three places.

    In the last of them the board is lifted.
    """
    rng = np.random.default_rng(0)
    shots: list[BoardShot] = []
    for x_m, y_m, z_m in ((0.45, -0.1, 0.0), (0.6, 0.1, 0.0), (0.55, 0.0, lifted_m)):
        place = np.array([x_m, y_m, THICKNESS_M + height_m + z_m])
        flat = scale * BOARD.corners_board * np.array([-1.0, 1.0, 1.0]) + place
        left, right = (view(tilt.apply(flat), CAMERA, side, rng) for side in (0, 1))
        shots.append(BoardShot(left=left, right=right))
    return table_plane(shots, BOARD, CAMERA, print_scale=scale, thickness_m=THICKNESS_M, at_m=(0.5, 0.0))


def test_a_level_table_at_height_0():
    plane = measured(Rotation.identity(), 0.0, scale=1.002)
    assert abs(plane.height_m) < 3e-4
    assert np.degrees(max(abs(plane.tilt_x_rad), abs(plane.tilt_y_rad))) < 0.05
    assert plane.residual_m < 1e-3


def test_height_and_tilts_are_found():
    plane = measured(Rotation.from_rotvec([0.01, 0.0, 0.0]), 0.005)
    assert plane.tilt_x_rad == pytest.approx(0.01, abs=1e-3)
    assert plane.tilt_y_rad == pytest.approx(0.0, abs=1e-3)
    assert plane.height_m == pytest.approx(0.005, abs=3e-4)
    assert measured(Rotation.from_rotvec([0.0, 0.01, 0.0]), 0.0).tilt_y_rad == pytest.approx(0.01, abs=1e-3)


def test_without_a_picture_of_the_board_nothing_is_measured():
    with pytest.raises(SkillFailure, match="no picture"):
        table_plane([], BOARD, CAMERA, print_scale=1.0, thickness_m=THICKNESS_M, at_m=(0.5, 0.0))


def test_a_board_that_does_not_lie_on_the_table_in_each_picture_is_refused():
    with pytest.raises(SkillFailure, match="mm off a plane, 3 mm are accepted"):
        measured(Rotation.identity(), 0.0, lifted_m=0.02)
