import numpy as np
import pytest

from dlokit.description.shapes import length
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.goal.pen import drawn_curve, on_plane
from dlokit.types.arrays import Float64Array

ROD_M, RADIUS_M, NODES = 0.5, 0.004, 31
ROD = RodOutline(nodes=NODES, length_m=ROD_M, radius_m=RADIUS_M)


def _curve(points: Float64Array) -> Float64Array:
    nodes = drawn_curve(points, ROD)
    assert nodes is not None
    return nodes


def _arc(turn_rad: float, arc_m: float, points: int = 40) -> Float64Array:
    angles = np.linspace(0.0, turn_rad, points)
    return np.column_stack([np.sin(angles), 1.0 - np.cos(angles)]) * arc_m / turn_rad + [0.4, 0.0]


def test_the_line_of_sight_meets_the_table_where_the_mouse_points() -> None:
    eye, place = np.array([1.6, -0.7, 1.0]), np.array([0.5, 0.1, 0.004])
    halfway = eye + 0.4 * (place - eye)
    met = on_plane(eye, halfway, 0.004)
    assert met is not None
    np.testing.assert_allclose(met, place[:2], atol=1e-12)


def test_a_line_of_sight_above_the_horizon_meets_no_table() -> None:
    eye = np.array([1.6, -0.7, 1.0])
    assert on_plane(eye, eye + np.array([0.0, 1.0, 0.1]), 0.004) is None


@pytest.mark.parametrize("arc_m", [0.2, 0.5, 0.9])
def test_a_drawn_line_becomes_a_goal_of_the_dlos_length_on_the_table(arc_m: float) -> None:
    nodes = _curve(_arc(1.5, arc_m))
    assert nodes.shape == (NODES, 3)
    assert length(nodes) == pytest.approx(ROD_M, rel=1e-6)
    assert np.all(nodes[:, 2] == pytest.approx(RADIUS_M))


def test_a_line_of_the_right_length_lies_where_it_was_drawn() -> None:
    drawn = _arc(1.5, ROD_M)
    nodes = _curve(drawn)
    # The filter moves an arc of 0.33 m radius inwards by sigma² / 2R = 1.4 mm.
    assert np.linalg.norm(nodes[[0, -1], :2] - drawn[[0, -1]], axis=1).max() < 0.005
    nearest = np.linalg.norm(nodes[:, None, :2] - _arc(1.5, ROD_M, 2000)[None], axis=2).min(axis=1)
    assert nearest.max() < 0.005


def test_the_jitter_of_a_hand_is_removed() -> None:
    rng = np.random.default_rng(1)
    line = np.linspace([0.5, -0.25], [0.5, 0.25], 120) + rng.normal(scale=0.002, size=(120, 2))
    assert np.abs(_curve(line)[:, 0] - 0.5).max() < 0.002


@pytest.mark.parametrize("points", [[], [[0.5, 0.0]], [[0.5, 0.0], [0.5, 0.0]], [[0.5, 0.0], [0.5, 0.02]]])
def test_a_click_is_no_goal(points: list[list[float]]) -> None:
    assert drawn_curve(np.array(points), ROD) is None
