import numpy as np

from dlokit import geometry
from dlokit.description.scene import Box, Scene
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.scene import thumbnail, with_shapes
from dlokit.types.arrays import BoolArray
from dlokit.types.image import CameraCalibration

CAMERA = CameraCalibration(
    width_px=64,
    height_px=48,
    fx_px=80.0,
    fy_px=80.0,
    cx_px=32.0,
    cy_px=24.0,
    T_world_camera=geometry.pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)),  # looks down
)


def test_a_picture_shrinks_to_the_width_and_keeps_its_proportions_and_colour() -> None:
    small = thumbnail(np.full((560, 640, 3), (10, 20, 30), dtype=np.uint8), 320)
    assert small.shape == (280, 320, 3)
    assert (small == (10, 20, 30)).all()


def test_a_small_picture_is_not_enlarged_and_a_grey_one_becomes_rgb() -> None:
    assert thumbnail(np.zeros((40, 60), dtype=np.uint8), 320).shape == (40, 60, 3)


def _outlines(scene: Scene) -> BoolArray:
    """The pixels (h, w) of a black picture in which the outlines of the fixtures are."""
    black = np.zeros((48, 64, 3), dtype=np.uint8)
    drawn = with_shapes(black, CAMERA, state_world=None, goal_world=None, fixtures=scene.fixtures)
    # Lines are smoothed: a pixel counts that has more than half of their colour.
    return np.asarray((drawn > 0.5 * np.array(palette.FIXTURES.color)).all(axis=2), dtype=np.bool_)


def test_the_outlines_of_fixtures_are_drawn_where_the_camera_sees_them() -> None:
    box = Box(name="box", position_m=(0.5, 0.0, 0.0), size_m=(0.2, 0.2, 0.001))
    rows, columns = np.nonzero(_outlines(Scene(fixtures=(box,))))
    # 0.2 m at 1 m and 80 px: 16 px around the middle, and nothing inside.
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (24, 40, 16, 32)
    assert not _outlines(Scene(fixtures=(box,)))[18:31, 26:39].any()


def test_a_picture_without_fixtures_stays_as_it_is_and_corners_behind_the_camera_are_omitted() -> None:
    assert not _outlines(Scene()).any()
    tall = Box(name="tall", position_m=(0.5, 0.0, 0.0), size_m=(0.2, 0.2, 1.5))
    drawn = _outlines(Scene(fixtures=(tall,)))
    assert drawn[16:33, 24:41].any()
    assert not drawn[:15].any()
