"""Files of shapes whose values cannot be meant are refused by the cause."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.description.point_files import csv_of, points_of_csv, read_points
from dlokit.errors import ShapeError

LINE = np.column_stack([np.full(20, 0.5), np.linspace(-0.2, 0.2, 20)])


def test_points_are_read_back_from_both_formats(tmp_path: Path):
    np.save(tmp_path / "line.npy", LINE)
    np.testing.assert_array_equal(read_points(str(tmp_path / "line.npy")), LINE)
    nodes = np.column_stack([LINE, np.zeros(20)])
    np.testing.assert_allclose(points_of_csv(csv_of(nodes), "line.csv"), nodes, atol=1e-6)


def test_columns_are_found_by_their_heading_and_decimal_commas_are_understood():
    columns = points_of_csv(b"node;z_m;y_m;x_m\n0;0,004;-0,2;0,5\n1;0,004;0,2;0,5\n", "goal.csv")
    np.testing.assert_array_equal(columns, [[0.5, -0.2, 0.004], [0.5, 0.2, 0.004]])


def test_a_shape_of_a_tracks_nodes_is_chosen_by_its_number(tmp_path: Path):
    rows = [f"{cloud},{node},0.5,{0.1 * node + cloud},0.004,1," for cloud in (0, 1) for node in range(3)]
    (tmp_path / "nodes.csv").write_text("\n".join(["cloud,node,x_m,y_m,z_m,visible,doubt", *rows]))
    np.testing.assert_allclose(read_points(f"{tmp_path / 'nodes.csv'}:1")[:, 1], [1.0, 1.1, 1.2])
    with pytest.raises(ShapeError, match=r"holds 2 shapes: name one, from .*nodes\.csv:0"):
        read_points(str(tmp_path / "nodes.csv"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x_mm,y_mm,z_mm\n500,-200,4\n500,200,4\n", "convert to metres"),
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
