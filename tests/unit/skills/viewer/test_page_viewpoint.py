import numpy as np
import pytest

from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD, VISITOR_LOOK_AT_M, VISITOR_POSITION_M, viewpoint


@pytest.mark.parametrize("aspect", [0.375, 0.5, 0.75, 1.0, 1.3, 2.0])
def test_the_area_of_goals_is_inside_the_picture_on_every_screen(aspect: float) -> None:
    eye = viewpoint(aspect)
    forward = np.array(VISITOR_LOOK_AT_M) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    corners = np.array([(x, y, 0.0) for x in TABLE_X_M for y in TABLE_Y_M]) - eye
    half = np.tan(VISITOR_FOV_RAD / 2.0)
    assert np.abs(corners @ right / (corners @ forward)).max() < half * aspect
    assert np.abs(corners @ down / (corners @ forward)).max() < half


def test_a_wide_picture_is_seen_from_near() -> None:
    np.testing.assert_allclose(viewpoint(1.5), VISITOR_POSITION_M)
