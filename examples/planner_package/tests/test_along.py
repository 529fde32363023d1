import numpy as np
import pytest
from dlokit_along.planner import AlongConfig, carried_along

from dlokit.skills.planning.config import strategies
from dlokit.testing import check_planner


def test_it_keeps_to_the_protocol() -> None:
    check_planner(AlongConfig)


def test_it_is_found_by_its_entry_point() -> None:
    assert strategies()["along"] is AlongConfig


def test_the_carried_node_reaches_its_goal_and_far_ones_stay() -> None:
    nodes = np.column_stack([np.linspace(0.0, 1.0, 11), np.zeros(11), np.zeros(11)])
    goal = nodes + np.array([0.0, 0.1, 0.0])
    after = carried_along(nodes, goal, 0.1)
    np.testing.assert_allclose(after[0, 0], goal[0])
    np.testing.assert_allclose(after[0, 1, 1], 0.1 * np.exp(-0.5))
    np.testing.assert_allclose(after[0, -1], nodes[-1], atol=1e-12)


def test_a_reach_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="must be above 0"):
        AlongConfig(reach_m=0.0)
