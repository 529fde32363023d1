"""The curve between few nodes: its length, its points, and the positions of the nodes on it."""

import numpy as np
import pytest
from cables import LENGTH_M, NODES, cable_nodes

from dlokit.extras.bench.observers.sequence import FINE, centre_line, lengths_between_m, smooth_line


def test_lengths_between_few_nodes_are_those_of_the_curve_not_of_the_chords() -> None:
    nodes = cable_nodes(1, 60.0)[0]
    chords = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    # The curvature is at most 2.5/m: a chord of 83 mm is 0.15 mm too short, a spline has a hundredth of that error.
    assert chords.sum() < LENGTH_M - 0.0005
    assert lengths_between_m(nodes) == pytest.approx(LENGTH_M / (NODES - 1), abs=2e-6)


def test_points_of_the_centre_line_are_equally_spaced_along_the_arc() -> None:
    nodes = cable_nodes(1, 60.0)[0][[0, 1, 2, 5, 6, 7, 9, 12]]  # markers are not equally spaced either
    steps = np.linalg.norm(np.diff(centre_line(nodes).points_world, axis=0), axis=1)
    assert steps == pytest.approx(steps.mean(), rel=0.01)
    assert len(steps) == FINE - 1


def test_every_node_is_found_on_the_centre_line() -> None:
    nodes = cable_nodes(1, 60.0)[0][[0, 1, 2, 5, 6, 7, 9, 12]]
    line = centre_line(nodes)
    # Half a step of 1 m in 400.
    assert np.linalg.norm(line.points_world[line.nodes_at] - nodes, axis=1).max() < 0.0013


def test_a_line_of_more_points_goes_through_every_node_and_many_nodes_stay_as_they_are() -> None:
    nodes = cable_nodes(1, 60.0)[0]
    assert smooth_line(nodes, 60)[::5] == pytest.approx(nodes)
    assert smooth_line(nodes, NODES) is nodes
