"""Grasps that are not repeated: marks are pairs of grasp and shape, slips of grasp and count."""

import numpy as np
import pytest

from dlokit.decision.attempt import GraspMemory

SHAPE = np.column_stack((np.linspace(0.3, 0.8, 31), np.zeros(31), np.full(31, 0.004)))


@pytest.mark.parametrize(("off_m", "kept"), [(0.0019, [3]), (0.0021, [])])
def test_a_grasp_stays_marked_while_the_shape_is_alike_and_no_longer(off_m: float, kept: list[int]) -> None:
    grasps = GraspMemory()
    grasps.mark([3], SHAPE)
    grasps.clear(SHAPE + np.array([0.0, off_m, 0.0]), 0.002)
    assert grasps.invalid().invalid_nodes.tolist() == kept


def test_without_a_distance_every_change_clears_all_marks_as_in_the_paper() -> None:
    grasps = GraspMemory()
    grasps.mark([3, 5], SHAPE)
    grasps.clear(SHAPE, 0.0)
    assert grasps.invalid().invalid_nodes.tolist() == []


def test_a_node_at_which_the_dlo_slipped_twice_is_invalid_whatever_the_shape() -> None:
    grasps = GraspMemory()
    for node in (7, 4, 7):
        grasps.slipped(node)
    grasps.clear(SHAPE, 0.0)
    assert grasps.invalid().invalid_nodes.tolist() == [7]
