import numpy as np

from dlokit.skills.viewer.scene import thumbnail


def test_a_picture_shrinks_to_the_width_and_keeps_its_proportions_and_colour() -> None:
    small = thumbnail(np.full((560, 640, 3), (10, 20, 30), dtype=np.uint8), 320)
    assert small.shape == (280, 320, 3)
    assert (small == (10, 20, 30)).all()


def test_a_small_picture_is_not_enlarged_and_a_grey_one_becomes_rgb() -> None:
    assert thumbnail(np.zeros((40, 60), dtype=np.uint8), 320).shape == (40, 60, 3)
