"""Distances of curves from fixtures."""

import numpy as np
import pytest

from dlokit.description import shapes
from dlokit.description.clearance import clear_of, clearances_m
from dlokit.description.scene import Box, Post
from dlokit.description.shapes import FIXTURE_CLEARANCE_M, builtin_shape, random_shape
from dlokit.errors import ShapeError

POST = Post(name="A", position_m=(0.5, 0.0, 0.0), diameter_m=0.02, height_m=0.03)
BLOCK = Box(name="B", position_m=(0.5, 0.1, 0.0), rpy_deg=(0.0, 0.0, 45.0), size_m=(0.04, 0.04, 0.05))


def test_the_clearance_of_a_curve_is_its_distance_from_a_surface():
    curve = np.array([[0.55, -0.2, 0.004], [0.55, 0.3, 0.004]])  # two points: the nearest is between them
    expected = [0.05 - 0.01, 0.05 - 0.02 * np.sqrt(2)]
    assert clearances_m(curve, (POST, BLOCK)) == pytest.approx(expected, abs=1e-4)
    above = curve - [0.05, 0.0, 0.0] + [0.0, 0.0, 0.06]
    assert clearances_m(above, (POST, BLOCK)) == pytest.approx([0.034, 0.014], abs=1e-4)


def test_a_curve_through_a_fixture_is_as_deep_inside_as_its_surface_is_away():
    through = np.array([[0.503, -0.2, 0.015], [0.503, 0.05, 0.015]])
    assert clearances_m(through, (POST,)) == pytest.approx([-0.007], abs=1e-4)


def test_a_curve_is_clear_when_every_fixture_is_far_enough():
    curve = np.array([[0.55, -0.2, 0.004], [0.55, 0.3, 0.004]])
    assert clear_of(curve, (POST,), 0.039)
    assert not clear_of(curve, (POST,), 0.041)
    assert not clear_of(curve, (POST, BLOCK), 0.03)
    assert clear_of(curve, (), 1.0)


def test_random_shapes_are_drawn_until_they_are_clear_of_the_fixtures():
    posts = tuple(
        Post(name=f"P{i}{j}", position_m=(0.42 + 0.1 * i, -0.15 + 0.15 * j, 0.0)) for i in range(3) for j in range(3)
    )
    redrawn = 0
    for seed in range(20):
        free, among, again = (
            random_shape(np.random.default_rng([seed, 0]), 0.5, 101, fixtures=fixtures)
            for fixtures in ((), posts, posts)
        )
        assert clear_of(among, posts, 0.004 + FIXTURE_CLEARANCE_M)
        assert np.array_equal(among, again)
        unobstructed = clear_of(free, posts, 0.004 + FIXTURE_CLEARANCE_M)
        assert np.array_equal(among, free) == unobstructed
        redrawn += not unobstructed
    assert 0 < redrawn < 20


def test_a_table_without_room_for_a_random_shape_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(shapes, "_ATTEMPTS", 50)
    wall = Box(name="wall", position_m=(0.525, 0.0, 0.0), size_m=(0.4, 0.6, 0.05))
    with pytest.raises(ShapeError, match="fits the table among the 1 fixtures"):
        random_shape(np.random.default_rng(0), 0.5, 51, fixtures=(wall,))
    assert not clear_of(builtin_shape("I", 0.5, 51), (wall,), 0.0)
