"""Paths: lift, carry at height, lower at the goal."""

import itertools

import numpy as np
import pytest

from dlokit import geometry
from dlokit.skills.planning.pick_place import carry_path

START = np.array([0.4, 0.0, 0.011])
END = np.array([0.5, 0.1, 0.011])
LIFT_M = 0.04


def test_the_rod_is_lifted_carried_and_lowered() -> None:
    path = carry_path(START, END, 0.3, 0.0, 0.05)
    assert path[0].position_m == pytest.approx(START + np.array([0.0, 0.0, 0.05]))
    assert all(pose.position_m[2] == pytest.approx(0.061) for pose in path[:-1])
    assert path[-1].position_m == pytest.approx(END)
    assert path[-2].position_m[:2] == pytest.approx(END[:2])


def test_poses_are_dense_enough() -> None:
    path = carry_path(START, END, 0.0, 1.5, LIFT_M)
    steps = np.diff([pose.position_m for pose in path[:-1]], axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 0.03 + 1e-9
    turns = [geometry.rotation(a).T @ geometry.rotation(b) for a, b in itertools.pairwise(path)]
    assert max(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)) for turn in turns) <= 0.3 + 1e-6


@pytest.mark.parametrize("turn_rad", [0.0, 1.2])
def test_the_gripper_ends_turned_as_asked(turn_rad: float) -> None:
    last = carry_path(START, END, 0.3, turn_rad, LIFT_M)[-1]
    assert last.wxyz == pytest.approx(geometry.downward(END, 0.3 + turn_rad).wxyz)
