"""Polylines: which part of a path a point is on."""

import pytest

from dlokit.geometry import segment_near

CORNERS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (0.3, 0.0, 0.1), (0.3, 0.0, 0.1), (0.3, 0.0, 0.0))
"""Up, across, a corner that is given twice, and down [m]."""


@pytest.mark.parametrize(
    ("point", "segment"),
    [
        ((0.0, 0.0, 0.05), 0),
        ((0.002, 0.001, 0.07), 0),  # beside it
        ((0.0, 0.0, -0.02), 0),  # before its begin
        ((0.0, 0.0, 0.1), 0),  # at a corner: the first of both
        ((0.2, 0.01, 0.1), 1),
        ((0.3, 0.0, 0.04), 3),
        ((0.3, 0.0, -0.02), 3),  # behind its end
    ],
)
def test_the_nearest_segment_of_a_path_is_found(point: tuple[float, float, float], segment: int) -> None:
    assert segment_near(CORNERS, point) == segment
