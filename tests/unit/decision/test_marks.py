"""Marks are pairs of grasp and shape."""

import numpy as np

from dlokit.decision.task import FailedPair, still_marked

SHAPE = np.column_stack((np.linspace(0.3, 0.8, 31), np.zeros(31), np.full(31, 0.004)))


def test_a_pair_stays_marked_while_the_shape_is_alike_and_no_longer() -> None:
    pair = FailedPair(node=3, nodes_world=SHAPE)
    assert still_marked([pair], SHAPE + np.array([0.0, 0.0019, 0.0]), 0.002) == [pair]
    assert still_marked([pair], SHAPE + np.array([0.0, 0.0021, 0.0]), 0.002) == []


def test_without_a_distance_every_change_clears_all_marks_as_in_the_paper() -> None:
    assert still_marked([FailedPair(node=3, nodes_world=SHAPE)], SHAPE, 0.0) == []
