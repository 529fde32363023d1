"""Candidates of `rollout`: laying, carrying, pushing."""

from dataclasses import replace

import numpy as np
import pytest
from rollout_bench import I_SHAPE, MODEL, S_SHAPE, scene, tools

from dlokit import geometry
from dlokit.description.arm.franka import FRANKA_HAND, PANDA
from dlokit.rod.rollout import PlanningRod, simulate
from dlokit.skills.planning.rollout.candidates import Candidate, PlanningScene
from dlokit.skills.planning.rollout.carrying import Carrying
from dlokit.skills.planning.rollout.laying import Laying
from dlokit.skills.planning.rollout.pushing import Pushing


def test_a_lay_down_ends_with_the_held_end_at_its_goal_and_the_rest_behind_it() -> None:
    for from_last, node in ((False, 0), (True, 30)):
        family = Laying(scene(), from_last=from_last)
        candidate = family.make(family.first(1, np.random.default_rng(0))[0])
        assert candidate is not None
        assert candidate.motion.node == node
        tool = candidate.motion.waypoints
        assert np.linalg.norm(tool[-1, :2] - S_SHAPE[node, :2]) < 0.013  # grasped 12 mm from the end
        assert np.linalg.norm(tool[2, :2] - S_SHAPE[30 - node, :2]) < 0.05  # it starts above the other end, with a lead
        assert np.all(np.diff(tool[2:, 2]) < 0.0)


def test_a_lay_down_is_corrected_by_its_prediction_error() -> None:
    family, errors_m = Laying(scene(), from_last=True), list[float]()
    numbers = family.first(1, np.random.default_rng(0))[0]
    for _ in range(4):
        candidate = family.make(numbers)
        assert candidate is not None
        nodes = simulate(MODEL, I_SHAPE, (PlanningRod(),), (candidate.motion,), 0.01).nodes_world[0, 0]
        errors_m.append(geometry.rmse_m(nodes, S_SHAPE))
        numbers = family.aimed(candidate.numbers, nodes)
    assert errors_m[-1] < 0.35 * errors_m[0]


def test_the_first_carries_are_of_nodes_spread_over_the_rod_the_farthest_first() -> None:
    here = scene()
    few = [int(numbers[0]) for numbers in Carrying(here, dragging=True).first(6, np.random.default_rng(0))]
    assert few[0] == np.argmax(here.error_m)
    assert np.diff(sorted([0, *few, here.count - 1])).max() <= 10
    every = [int(numbers[0]) for numbers in Carrying(here, dragging=True).first(100, np.random.default_rng(0))]
    assert set(every) == set(np.argsort(-here.error_m, kind="stable")[::2].tolist())


def test_the_target_of_a_carry_compensates_for_spring_back() -> None:
    family = Carrying(scene(), dragging=True)
    numbers = family.first(1, np.random.default_rng(0))[0]
    short = S_SHAPE - np.array([0.01, 0.0, 0.0])
    more = family.aimed(numbers, short) - numbers
    assert more[1] > 0.005
    assert np.abs(np.delete(more, 1)).max() == 0.0


def test_if_the_end_is_marked_the_next_node_is_grasped() -> None:
    family = Laying(scene(marked=(0,)), from_last=False)
    candidate = family.make(family.first(1, np.random.default_rng(0))[0])
    assert candidate is not None
    assert candidate.motion.node == 1


def push_of(direction_rad: float, length_m: float = 0.05, marked: tuple[int, ...] = ()) -> Candidate | None:
    return Pushing(scene(marked=marked)).make(np.array([0.5, direction_rad, 0.006, length_m, 0.0, 0.0, 0.15]))


@pytest.mark.parametrize("direction_rad", [0.0, np.pi])
def test_a_push_moves_the_middle_by_its_length_in_its_direction(direction_rad: float) -> None:
    candidate = push_of(direction_rad)
    assert candidate is not None
    end = simulate(MODEL, I_SHAPE, (PlanningRod(),), (candidate.motion,), 0.005).nodes_world[0, 0]
    along = geometry.tangents(I_SHAPE)[15, :2]
    way = np.cos(direction_rad) * np.array([-along[1], along[0]])
    # The fingers' compliance is a millimetre, and that of the bend which they leave another.
    assert (end - I_SHAPE)[15, :2] @ way == pytest.approx(0.05, abs=0.004)
    assert np.linalg.norm((end - I_SHAPE)[[0, 30]], axis=1).max() < 0.02


def test_a_push_is_planned_with_the_fingers_of_the_arm() -> None:
    wide = replace(FRANKA_HAND, pad_half_length_m=0.03)
    wide_arm = replace(tools(), arm=replace(PANDA, gripper=wide))
    numbers = np.array([0.5, 0.0, 0.006, 0.05, 0.0, 0.0, 0.15])
    own = Pushing(PlanningScene(I_SHAPE, S_SHAPE, frozenset(), wide_arm)).make(numbers)
    usual = push_of(0.0)
    assert own is not None
    assert usual is not None
    farther_m = np.linalg.norm((own.motion.waypoints - usual.motion.waypoints)[0, :2])
    assert farther_m == pytest.approx(wide.pad_half_length_m - FRANKA_HAND.pad_half_length_m)
    ends = simulate(MODEL, I_SHAPE, (PlanningRod(),), (own.motion, usual.motion), 0.005).nodes_world[0]
    moved_m = np.linalg.norm((ends - I_SHAPE)[:, 15], axis=1)
    assert moved_m[0] == pytest.approx(moved_m[1], abs=0.003)


def test_a_push_along_the_rod_onto_it_or_at_a_marked_node_is_no_candidate() -> None:
    assert push_of(1.3) is None
    assert push_of(0.0, marked=(15,)) is None
    assert push_of(0.0, length_m=-0.01) is None
    hairpin = np.concatenate((I_SHAPE[:16], I_SHAPE[:15][::-1] + np.array([0.02, 0.0, 0.0])))
    beside = Pushing(PlanningScene(hairpin, S_SHAPE, frozenset(), tools()))
    tries = [beside.make(np.array([0.25, way, 0.006, 0.05, 0.0, 0.0, 0.15])) for way in (0.0, np.pi)]
    assert [made is None for made in tries].count(True) == 1, "on one side lies the other strand"


def test_a_waypoint_out_of_reach_makes_no_candidate() -> None:
    low = PlanningScene(I_SHAPE, S_SHAPE, frozenset(), tools(lambda T: float(T.position_m[2]) < 0.3))
    family = Laying(low, from_last=False)
    assert family.make(family.first(1, np.random.default_rng(0))[0]) is None
