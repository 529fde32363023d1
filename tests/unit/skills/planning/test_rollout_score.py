"""The score of `rollout`: the remaining error after an action."""

from dataclasses import replace

import numpy as np
import pytest
from rollout_bench import MODEL, S_SHAPE

from dlokit import geometry
from dlokit.description.dlo import SILICONE_HOSE, SOFT_ROPE, WIRE_B
from dlokit.rod.rollout import RolloutResult
from dlokit.skills.planning.actions import FeasibilityConfig
from dlokit.skills.planning.rollout.score import (
    cautious_m,
    least_remaining_m,
    remaining_m,
    usual_error_m,
)
from dlokit.types.action import Drag, LayDown, PickPlace
from dlokit.types.arrays import Float64Array


def lying(*shapes: Float64Array, nearest_m: float = 0.1) -> RolloutResult:
    return RolloutResult(nodes_world=np.stack(shapes)[None], nearest_m=np.full((1, len(shapes)), nearest_m))


def scored(played: RolloutResult, goal: Float64Array = S_SHAPE) -> Float64Array:
    miss_m = np.zeros(played.nearest_m.shape[1])
    return remaining_m(played, miss_m, goal, MODEL.radius_m, FeasibilityConfig())[0]


def test_of_two_shapes_with_equal_error_the_one_with_local_error_is_better() -> None:
    here, everywhere = S_SHAPE.copy(), S_SHAPE.copy()
    here[:6, 0] += 0.03
    everywhere[:, 0] += geometry.rmse_m(here, S_SHAPE)
    score = scored(lying(here, everywhere))
    assert score[0] < score[1] - 0.002


def test_a_tangle_and_a_rod_off_the_table_have_a_high_cost() -> None:
    off = S_SHAPE + np.array([0.3, 0.0, 0.0])
    clean, crossed, outside = (
        scored(lying(S_SHAPE))[0],
        scored(lying(S_SHAPE, nearest_m=0.008))[0],  # as near as a diameter: one strand went through another
        scored(lying(off))[0],
    )
    assert crossed > clean + 0.2
    assert outside > geometry.rmse_m(off, S_SHAPE) + 0.05


def test_of_two_actions_with_equal_mean_the_more_certain_one_is_better() -> None:
    scores = np.array([[0.01, 0.02], [0.03, 0.02]])
    assert cautious_m(scores, 0.0)[0] == pytest.approx(cautious_m(scores, 0.0)[1])
    assert cautious_m(scores, 1.0)[0] > cautious_m(scores, 1.0)[1]


def test_no_score_is_below_the_prediction_error_of_its_kind() -> None:
    miss_m = np.array([0.008, 0.008])
    played = lying(S_SHAPE, S_SHAPE + np.array([0.002, 0.0, 0.0]))
    at_goal, beside = remaining_m(played, miss_m, S_SHAPE, MODEL.radius_m, FeasibilityConfig())[0]
    assert at_goal == pytest.approx(least_remaining_m(0.008))
    assert beside > at_goal


def test_a_lay_down_needs_a_larger_predicted_gain_than_a_small_correction() -> None:
    assert usual_error_m(LayDown, MODEL) > usual_error_m(PickPlace, MODEL) > usual_error_m(Drag, MODEL)
    near = lying(S_SHAPE + np.array([0.004, 0.0, 0.0]))
    score = [
        remaining_m(near, np.array([usual_error_m(kind, MODEL)]), S_SHAPE, MODEL.radius_m, FeasibilityConfig())[0, 0]
        for kind in (LayDown, Drag)
    ]
    assert score[0] > score[1] + 0.004


def test_a_lay_down_of_a_stiff_dlo_has_a_larger_expected_error() -> None:
    rope, hose, wire = (
        replace(MODEL, bending_stiffness_n_m2=preset.bending_stiffness_n_m2, mass_kg_m=preset.mass_per_length_kg_m)
        for preset in (SOFT_ROPE, SILICONE_HOSE, WIRE_B)
    )
    assert usual_error_m(LayDown, rope) == LayDown.facts.usual_error_m
    assert usual_error_m(LayDown, hose) > 2.0 * LayDown.facts.usual_error_m
    assert usual_error_m(LayDown, wire) > 2.0 * usual_error_m(LayDown, hose)
    assert usual_error_m(Drag, wire) == usual_error_m(Drag, rope)
