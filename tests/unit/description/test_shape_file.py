"""Files of shapes whose values cannot be meant are refused by the cause."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.description.shapes import csv_of, points_of_csv, read_points
from dlokit.errors import ShapeError

LINE = np.column_stack([np.full(20, 0.5), np.linspace(-0.2, 0.2, 20)])


def test_points_are_read_back_from_both_formats(tmp_path: Path):
    np.save(tmp_path / "line.npy", LINE)
    np.testing.assert_array_equal(read_points(str(tmp_path / "line.npy")), LINE)
    nodes = np.column_stack([LINE, np.zeros(20)])
    np.testing.assert_allclose(points_of_csv(csv_of(nodes), "line.csv"), nodes, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x;y\n0,5;-0,2\n0,5;0,2\n", "line 2: '0,5;-0,2' has decimal commas"),
        ("node,x,y\n0,0.5,0\n1,0.5,0.1\n2,0.5,0.2\n", "counts its points in the first column"),
        ("1,0.5,0\n2,0.5,0.1\n3,0.5,0.2\n", "counts its points in the first column"),
        ("0.5,0.1\n", "1 point"),
        ("0.5,0.1\n0.5,nan\n", "first in point 1"),
        ("0.5,0.1\n0.5,0.1\n", "zero length"),
        ("500,0\n500,400\n", "400 m long"),
    ],
)
def test_values_that_cannot_be_meant_are_refused_by_name(text: str, says: str):
    with pytest.raises(ShapeError, match=says):
        points_of_csv(text.encode(), "goal.csv")


def test_a_transposed_array_is_named(tmp_path: Path):
    np.save(tmp_path / "goal.npy", LINE.T)
    with pytest.raises(ShapeError, match="Save its transpose: a row for each point"):
        read_points(str(tmp_path / "goal.npy"))
