"""Which parts of a planning rod are two strands: not those that a bend allows its radius."""

import numpy as np
import pytest

from dlokit.geometry import resample
from dlokit.rod.planning_rod import Contacts, simulate_motion


@pytest.mark.parametrize("radius_m", [0.001, 0.004, 0.02])
def test_a_rod_in_a_bend_that_its_radius_allows_is_one_strand(radius_m: float) -> None:
    bend_m, edge_m = 1.5 * max(radius_m, 0.02), 0.0125
    turn = np.linspace(0.0, np.pi, 200)
    bend = bend_m * np.column_stack((np.cos(turn), np.sin(turn), 0.0 * turn))
    curve = np.vstack(([bend_m, -0.1, 0.0], bend, [-bend_m, -0.1, 0.0])) + np.array([0.5, 0.0, radius_m])
    nodes = resample(curve, round((0.2 + np.pi * bend_m) / edge_m) + 1)
    rod = np.array([edge_m, 1e-3, 0.0, 0.0, 0.0, 0.5, 0.1, radius_m, np.inf])
    nowhere, end = Contacts(tool=np.zeros((1, 4))), np.empty_like(nodes)
    nearest_m = simulate_motion(nodes, rod, 1e-4, 0, nowhere, end)
    assert nearest_m > 1.3 * 2.0 * radius_m  # nearer strands count as touching (`rollout.score`)
