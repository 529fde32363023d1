"""The nearest shape that friction holds: it holds in the cell's physics, and no nearer one does."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.dlo import DloPreset
from dlokit.description.shapes import builtin_shape, random_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.elastic import add_ground, add_rod, rod_nodes, set_rod_nodes, set_rod_physics
from dlokit.rod.equilibrium import nearest_static
from dlokit.rod.rollout import settle
from dlokit.types.arrays import Float64Array

MODEL = BelievedDlo()
S_SHAPE = builtin_shape("S", 0.5, 31)


def elastic_m3(model: BelievedDlo) -> float:
    return model.bending_stiffness_n_m2 / (model.friction * 9.81 * model.mass_kg_m)


def moves_m(nodes_world: Float64Array, model: BelievedDlo) -> float:
    """Displacement of MuJoCo's rod within a second after its release."""
    spec = mujoco.MjSpec()
    set_rod_physics(spec, 0.0025)
    add_ground(spec, model.friction)
    rope = DloPreset(
        name="rope",
        mass_per_length_kg_m=model.mass_kg_m,
        bending_stiffness_n_m2=model.bending_stiffness_n_m2,
        friction=model.friction,
    )
    add_rod(spec, rope, len(nodes_world))
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    set_rod_nodes(compiled, data, nodes_world)
    mujoco.mj_step(compiled, data, 400)
    return geometry.rmse_m(rod_nodes(compiled, data), nodes_world)


@pytest.mark.parametrize("stiffness_n_m2", [5e-5, 2e-4, 1e-3])
def test_it_holds_with_a_quarter_of_friction_in_reserve_though_the_goal_does_not(stiffness_n_m2: float) -> None:
    model = replace(MODEL, bending_stiffness_n_m2=stiffness_n_m2)
    held = nearest_static(S_SHAPE, elastic_m3(model) / 0.75)
    assert held.lacking < 0.05
    # A rod that friction does not hold straightens by centimetres; below a millimetre it only rolled into place.
    assert moves_m(held.nodes_world, model) < 0.001 < 0.003 < moves_m(S_SHAPE, model)
    assert geometry.arc_lengths(held.nodes_world)[-1] == pytest.approx(geometry.arc_lengths(S_SHAPE)[-1], rel=1e-6)


def test_a_goal_that_friction_holds_is_its_own_nearest() -> None:
    gentle = random_shape(np.random.default_rng(1000), 0.5, 31, min_bend_radius_m=0.15)
    assert nearest_static(gentle, 0.03**3).rmse_m < 1e-4


def test_a_stiffer_rod_has_a_farther_nearest_shape_but_never_farther_than_its_rest_shape() -> None:
    distances = [nearest_static(S_SHAPE, length_m**3).rmse_m for length_m in (0.05, 0.07, 0.09, 0.12, 0.2)]
    assert distances == sorted(distances)
    for stiffness_n_m2, length_m in ((1e-4, 0.079), (2e-4, 0.099), (1e-3, 0.17)):
        model = replace(MODEL, bending_stiffness_n_m2=stiffness_n_m2)
        assert elastic_m3(model) == pytest.approx(length_m**3, rel=0.05)
        settled_m = geometry.rmse_m(settle(model, S_SHAPE), S_SHAPE)
        assert nearest_static(S_SHAPE, elastic_m3(model)).rmse_m < settled_m


def test_a_bend_is_widened_to_the_requested_radius() -> None:
    radius_m = 0.15
    held = nearest_static(S_SHAPE, 0.0, min_radius_m=radius_m)
    along = np.diff(held.nodes_world[:, :2], axis=0)
    turns = np.abs(np.diff(np.unwrap(np.arctan2(along[:, 1], along[:, 0]))))
    assert turns.max() == pytest.approx(0.5 / 30 / radius_m, rel=0.01)
    assert held.rmse_m > 0.02


def test_a_dlo_that_keeps_bends_holds_nearer_to_the_goal() -> None:
    springy, kept = (nearest_static(S_SHAPE, 0.2**3, yield_curvature_1_m=most).rmse_m for most in (np.inf, 1.0))
    assert springy > 0.05
    assert kept < 0.005
