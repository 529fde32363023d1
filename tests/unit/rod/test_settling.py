"""A released rod keeps its shape as far as its bends are permanent."""

from dataclasses import replace

import mujoco
import pytest

from dlokit import geometry
from dlokit.description.dlo import WIRE_B
from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.chain import Chain, add_chain
from dlokit.rod.elastic import add_ground, set_rod_physics
from dlokit.rod.rollout import PlanningRod, settle

MODEL = BelievedDlo(bending_stiffness_n_m2=1e-4)
S_SHAPE = builtin_shape("S", 0.5, 31)


def test_a_rod_whose_every_bend_is_kept_stays_however_stiff() -> None:
    stiff = replace(MODEL, bending_stiffness_n_m2=1e-3)
    assert geometry.rmse_m(settle(stiff, S_SHAPE, PlanningRod(yield_curvature_1_m=1e-6)), S_SHAPE) < 1e-3
    assert geometry.rmse_m(settle(stiff, S_SHAPE), S_SHAPE) > 0.04


def test_it_springs_back_as_far_as_the_chain_that_yields() -> None:
    wire = replace(WIRE_B, yield_curvature_1_m=3.0)
    spec = mujoco.MjSpec()
    set_rod_physics(spec, 0.0025)
    add_ground(spec, wire.friction)
    add_chain(spec, wire, 41)
    compiled = spec.compile()
    data = mujoco.MjData(compiled)
    chain = Chain(compiled, data, 0.0)
    chain.place(builtin_shape("S", 0.5, 41, radius_m=wire.radius_m))
    mujoco.mj_step(compiled, data, 800)
    chain_m = geometry.rmse_m(geometry.resample(chain.nodes_world, 31), S_SHAPE - [0.0, 0.0, 0.001])
    model = BelievedDlo(
        radius_m=wire.radius_m,
        bending_stiffness_n_m2=wire.bending_stiffness_n_m2,
        mass_kg_m=wire.mass_per_length_kg_m,
        friction=wire.friction,
    )
    quick_m = geometry.rmse_m(settle(model, S_SHAPE, PlanningRod(yield_curvature_1_m=3.0)), S_SHAPE)
    # Two different models: a fraction of the spring-back of an elastic wire, 54 mm.
    assert quick_m == pytest.approx(chain_m, abs=0.004)
    assert chain_m > 0.008
