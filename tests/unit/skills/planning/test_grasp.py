"""Grasps: across the rod, inside its ends, fingers on nothing else."""

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.shapes import builtin_shape
from dlokit.skills.planning.grasp import (
    CLEARANCE_M,
    END_INSET_M,
    FINGER_THICKNESS_M,
    OPENINGS_M,
    fitting_opening_m,
    grasp_fraction,
    grasp_pose,
    grasp_yaw,
    gripper_fits,
    rod_point,
)
from dlokit.types.arrays import Float64Array

HEIGHT_M = 0.011
RADIUS_M = 0.004
I_SHAPE = builtin_shape("I", 0.5, 31)


def hairpin(gap_m: float) -> Float64Array:
    """Two parallel strands along y, `gap_m` apart, joined by half a circle."""
    t = np.linspace(0.0, 1.0, 60)
    bend = np.pi * t
    down = np.column_stack([np.full(60, 0.5), 0.2 - 0.2 * t])
    turn = np.column_stack([0.5 + gap_m / 2 * (1 - np.cos(bend)), -gap_m / 2 * np.sin(bend)])
    up = np.column_stack([np.full(60, 0.5 + gap_m), 0.2 * t])
    points = np.concatenate([down, turn[1:-1], up])
    return geometry.resample(np.column_stack([points, np.full(len(points), 0.004)]), 41)


def test_the_gripper_is_across_the_rod_and_points_down() -> None:
    point = rod_point(I_SHAPE, 0.5)
    T = geometry.rotation(grasp_pose(point, grasp_yaw(PANDA, point, 0.0, (0.0, 0.0)), HEIGHT_M))
    assert np.abs(T[:, 0] @ [0.0, 1.0, 0.0]) == pytest.approx(1.0)  # tool x along the rod, which lies along y
    assert T[:, 2] == pytest.approx([0.0, 0.0, -1.0])


def test_the_end_is_grasped_a_little_inside() -> None:
    share = grasp_fraction(I_SHAPE, 0)
    assert rod_point(I_SHAPE, share).position_world[1] == pytest.approx(-0.25 + END_INSET_M)
    assert grasp_fraction(I_SHAPE, 30) == pytest.approx(1.0 - share)
    assert grasp_fraction(I_SHAPE, 15) == pytest.approx(0.5)


@pytest.mark.parametrize("turn_rad", [-1.5, 0.0, 1.5])
@pytest.mark.parametrize("node", [0, 7, 15, 30])
def test_the_wrist_keeps_room_to_turn(node: int, turn_rad: float) -> None:
    shape = builtin_shape("S", 0.5, 31)
    point = rod_point(shape, node / 30)
    yaw = grasp_yaw(PANDA, point, turn_rad, (0.0, 0.0))
    middle = np.arctan2(point.position_world[1], point.position_world[0]) + PANDA.roomiest_yaw_rad
    # Joint 7 turns 2.89 rad either way from its middle.
    assert abs(yaw - middle) < 2.8
    assert abs(yaw + turn_rad - middle) < 2.8
    assert np.sin(yaw - point.yaw_rad) == pytest.approx(0.0, abs=1e-9)


def test_the_widest_opening_is_taken_on_a_free_rod() -> None:
    assert fitting_opening_m(PANDA.gripper, I_SHAPE, rod_point(I_SHAPE, 0.5), RADIUS_M) == OPENINGS_M[0]


@pytest.mark.parametrize("radius_m", [0.002, 0.006])
def test_the_gripper_fits_next_to_a_strand_up_to_the_boundary(radius_m: float) -> None:
    opening = 0.03
    # Free from this distance on: the finger's far side, the clearance, the neighbour's radius.
    reach = opening / 2 + FINGER_THICKNESS_M + CLEARANCE_M + radius_m
    free, touched = hairpin(reach + 0.002), hairpin(reach - 0.002)
    at = 0.2
    assert gripper_fits(free, rod_point(free, at), opening, radius_m)
    assert not gripper_fits(touched, rod_point(touched, at), opening, radius_m)


def test_two_strands_between_the_fingers_are_one_too_many() -> None:
    strands = hairpin(0.015)
    assert not gripper_fits(strands, rod_point(strands, 0.2), 0.05, RADIUS_M)


def test_a_narrower_opening_is_chosen_if_the_wide_one_hits_the_rod() -> None:
    strands = hairpin(0.036)
    assert fitting_opening_m(PANDA.gripper, strands, rod_point(strands, 0.2), RADIUS_M) == 0.03


def test_no_opening_fits_adjacent_strands() -> None:
    strands = hairpin(0.018)
    assert fitting_opening_m(PANDA.gripper, strands, rod_point(strands, 0.2), RADIUS_M) is None


@pytest.mark.parametrize("radius_m", [0.001, 0.004])
def test_the_other_strand_of_a_sharp_bend_is_one_too_many(radius_m: float) -> None:
    strands = geometry.resample(hairpin(0.012), 201)
    # 2 mm before the bend, 23 mm along the rod from the place opposite: both strands would be between the fingers.
    at = rod_point(strands, 0.198 / float(geometry.arc_lengths(strands)[-1]))
    assert not gripper_fits(strands, at, 0.05, radius_m)
