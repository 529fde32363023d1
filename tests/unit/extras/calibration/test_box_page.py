import numpy as np
import pytest

from dlokit import geometry
from dlokit.extras.calibration.box_page import LEAST_SIDE_M, ChosenBox

HERE = geometry.pose((0.0, 0.0, 0.0))
RAISED = geometry.pose((0.0, 0.0, 0.1), (0.999, 0.0447, 0.0, 0.0))
BOX = ChosenBox(frame=HERE, lower_m=(0.3, -0.2, -0.1), upper_m=(0.7, 0.2, 0.3))


def test_a_corner_follows_the_drag_and_never_passes_the_other_one():
    assert BOX.dragged(1, np.array([0.8, 0.1, 0.2])).upper_m == pytest.approx((0.8, 0.1, 0.2))
    assert BOX.dragged(0, np.array([0.9, -0.3, 0.0])).lower_m == pytest.approx((0.7 - LEAST_SIDE_M, -0.3, 0.0))
    assert BOX.dragged(1, np.array([0.0, 0.0, 0.0])).upper_m == pytest.approx((0.32, 0.0, 0.0))


def test_on_the_table_the_box_stands_on_its_plane_and_is_dragged_in_its_frame():
    box = BOX.on(RAISED)
    assert box.lower_m == (0.3, -0.2, 0.0)
    np.testing.assert_allclose(box.place(0), geometry.transform(RAISED, [[0.3, -0.2, 0.0]])[0])
    moved = box.dragged(1, geometry.transform(RAISED, [[0.6, 0.3, 0.5]])[0])
    assert moved.upper_m == pytest.approx((0.6, 0.3, 0.5))


def test_the_points_in_the_box_are_those_between_its_corners_in_its_frame():
    inside, outside = geometry.transform(RAISED, [[0.5, 0.0, 0.01]]), geometry.transform(RAISED, [[0.5, 0.0, -0.01]])
    held = BOX.on(RAISED).holds(np.concatenate([inside, outside]).astype(np.float32))
    np.testing.assert_allclose(held, inside, atol=1e-6)


def test_the_edges_join_corners_that_differ_along_one_axis():
    assert BOX.edges.shape == (12, 2, 3)
    sides = np.abs(BOX.edges[:, 1] - BOX.edges[:, 0])
    assert np.all(np.count_nonzero(sides > 1e-6, axis=1) == 1)
    assert len({tuple(map(tuple, edge)) for edge in np.round(BOX.edges, 4).tolist()}) == 12
