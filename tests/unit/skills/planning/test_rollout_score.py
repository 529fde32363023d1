"""The score of `rollout`: what remains to be done after an action."""

from dataclasses import replace

import numpy as np
import pytest
from rollout_bench import MODEL, S_SHAPE

from dlokit import geometry
from dlokit.description.dlo import SILICONE_HOSE, SOFT_ROPE, WIRE_B
from dlokit.rod.rollout import Played
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.rollout.score import (
    LAY_DOWN_MISS_M,
    cautious_m,
    least_remaining_m,
    remaining_m,
    usual_miss_m,
)
from dlokit.types.action import Drag, LayDown, PickPlace
from dlokit.types.arrays import Float64Array


def lying(*shapes: Float64Array, nearest_m: float = 0.1) -> Played:
    return Played(nodes_world=np.stack(shapes)[None], nearest_m=np.full((1, len(shapes)), nearest_m))


def scored(played: Played, goal: Float64Array = S_SHAPE) -> Float64Array:
    miss_m = np.zeros(played.nearest_m.shape[1])
    return remaining_m(played, miss_m, goal, MODEL.radius_m, FeasibilityConfig())[0]


def test_of_two_shapes_with_one_error_that_is_better_whose_error_sits_in_one_place() -> None:
    here, everywhere = S_SHAPE.copy(), S_SHAPE.copy()
    here[:6, 0] += 0.03
    everywhere[:, 0] += geometry.rmse_m(here, S_SHAPE)
    score = scored(lying(here, everywhere))
    assert score[0] < score[1] - 0.002


def test_a_tangle_and_a_rod_off_the_table_are_dear() -> None:
    off = S_SHAPE + np.array([0.3, 0.0, 0.0])
    clean, crossed, outside = (
        scored(lying(S_SHAPE))[0],
        scored(lying(S_SHAPE, nearest_m=0.008))[0],  # as near as a diameter: one strand went through another
        scored(lying(off))[0],
    )
    assert crossed > clean + 0.2
    assert outside > geometry.rmse_m(off, S_SHAPE) + 0.05


def test_a_doubtful_action_counts_for_less_than_a_sure_one_of_the_same_mean() -> None:
    scores = np.array([[0.01, 0.02], [0.03, 0.02]])
    assert cautious_m(scores, 0.0)[0] == pytest.approx(cautious_m(scores, 0.0)[1])
    assert cautious_m(scores, 1.0)[0] > cautious_m(scores, 1.0)[1]


def test_no_shape_however_near_the_goal_scores_below_what_its_kind_misses_alone() -> None:
    miss_m = np.array([0.008, 0.008])
    played = lying(S_SHAPE, S_SHAPE + np.array([0.002, 0.0, 0.0]))
    at_goal, beside = remaining_m(played, miss_m, S_SHAPE, MODEL.radius_m, FeasibilityConfig())[0]
    assert at_goal == pytest.approx(least_remaining_m(0.008))
    assert beside > at_goal


def test_a_lay_down_must_promise_more_than_a_small_correction_because_it_misses_by_more() -> None:
    assert usual_miss_m(LayDown, MODEL) > usual_miss_m(PickPlace, MODEL) > usual_miss_m(Drag, MODEL)
    near = lying(S_SHAPE + np.array([0.004, 0.0, 0.0]))
    score = [
        remaining_m(near, np.array([usual_miss_m(kind, MODEL)]), S_SHAPE, MODEL.radius_m, FeasibilityConfig())[0, 0]
        for kind in (LayDown, Drag)
    ]
    assert score[0] > score[1] + 0.004


def test_a_dlo_that_does_not_drape_is_not_expected_to_be_laid_down_well() -> None:
    rope, hose, wire = (
        replace(MODEL, bending_stiffness_n_m2=preset.bending_stiffness_n_m2, mass_kg_m=preset.mass_per_length_kg_m)
        for preset in (SOFT_ROPE, SILICONE_HOSE, WIRE_B)
    )
    assert usual_miss_m(LayDown, rope) == LAY_DOWN_MISS_M
    assert usual_miss_m(LayDown, hose) > 2.0 * LAY_DOWN_MISS_M
    assert usual_miss_m(LayDown, wire) > 2.0 * usual_miss_m(LayDown, hose)
    assert usual_miss_m(Drag, wire) == usual_miss_m(Drag, rope)
