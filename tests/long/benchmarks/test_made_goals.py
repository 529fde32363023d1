"""Random goals of the feasibility bench: those of any seed fit on the table."""

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.shapes import CENTRE_M, length, self_clearance_m
from parts.made_goals import made_goals, placed


def test_each_seed_gives_the_same_valid_goals_one_of_each_kind() -> None:
    for seed in range(1000, 1005):
        goals = dict(made_goals(seed, 0.5, 0.003))
        assert [name.split("-")[0] for name in goals] == ["arcs", "spiral", "wave", "random"]
        for name, goal in goals.items():
            assert length(goal) == pytest.approx(0.5, rel=1e-3)  # a polyline of 100 edges cuts corners
            assert self_clearance_m(goal) > 0.04  # fingers fit between
            assert np.all(goal[:, 2] == 0.003)
            np.testing.assert_array_equal(goal, dict(made_goals(seed, 0.5, 0.003))[name])


def test_goals_of_two_seeds_differ() -> None:
    first, second = dict(made_goals(1000, 0.5, 0.004)), dict(made_goals(1001, 0.5, 0.004))
    assert geometry.rmse_m(first["wave-1000"], second["wave-1001"]) > 0.005


def test_a_curve_of_a_file_is_scaled_to_the_rod_and_lies_in_the_middle_of_the_table() -> None:
    goal = placed(np.array([[3.0, 1.0, 0.0], [3.0, 2.0, 0.0], [4.0, 2.0, 0.0]]), 0.5, 0.004)
    assert length(goal) == pytest.approx(0.5)
    middle = (goal[:, :2].min(axis=0) + goal[:, :2].max(axis=0)) / 2.0
    assert middle == pytest.approx(CENTRE_M)
