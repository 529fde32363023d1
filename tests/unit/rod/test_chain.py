"""The chain: statics against beam theory, yield, energy, and rest."""

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.dlo import SOFT_ROPE, STIFF_WIRE, DloPreset
from dlokit.description.shapes import builtin_shape
from dlokit.description.table import Table
from dlokit.errors import ConfigError
from dlokit.functional.cell import surroundings
from dlokit.rod import elastic
from dlokit.rod.chain import Chain, add_chain
from dlokit.types.arrays import Float64Array

STEP_S = 0.0025
NODES = 41
LINK_M = 0.5 / 40
WIRE = dataclasses.replace(STIFF_WIRE, yield_curvature_1_m=4.0)


def build(preset: DloPreset, nodes: int = NODES, *, table: bool = False, held: bool = False) -> tuple[Any, Any, Chain]:
    spec: Any = mujoco.MjSpec()
    elastic.set_rod_physics(spec, STEP_S)
    if table:
        surroundings.add_table(spec, Table(), friction=preset.friction)
    add_chain(spec, preset, nodes)
    if held:
        root = spec.body(f"chain/link_{(nodes - 1) // 2}")
        spec.delete(root.joints[0])
    if not table:
        spec.option.gravity = [0.0, 0.0, 0.0]
        spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # a held link has no parent to filter
    model = spec.compile()
    data: Any = mujoco.MjData(model)
    return model, data, Chain(model, data, preset.curl_1_m)


def arc(curvature_1_m: float, nodes: int = NODES) -> Float64Array:
    """A flat arc high above the table."""
    turns = curvature_1_m * np.linspace(-0.25, 0.25, nodes)
    return np.column_stack([np.sin(turns) / curvature_1_m, (1 - np.cos(turns)) / curvature_1_m, np.full(nodes, 0.5)])


def curvatures(nodes: Float64Array) -> Float64Array:
    along = np.diff(nodes, axis=0)
    turned = np.cross(along[:-1], along[1:])[:, 2] / LINK_M**2
    return np.arcsin(np.clip(turned, -1.0, 1.0)) / LINK_M


def settled(model: Any, data: Any, chain: Chain, duration_s: float) -> Float64Array:
    mujoco.mj_step(model, data, nstep=round(duration_s / STEP_S))
    mujoco.mj_kinematics(model, data)
    return chain.nodes_world


def test_a_chain_is_where_it_was_placed():
    model, data, chain = build(SOFT_ROPE)
    wanted = builtin_shape("S", 0.5, NODES)
    chain.place(wanted)
    mujoco.mj_kinematics(model, data)
    # Chords of equally spaced points on a curve are slightly shorter than the links; this adds up towards the ends.
    assert np.linalg.norm(chain.nodes_world - wanted, axis=1).max() < 5e-4


def test_links_keep_their_length_through_a_fall_onto_the_table():
    model, data, chain = build(SOFT_ROPE, table=True)
    chain.place(builtin_shape("S", 0.5, NODES) + np.array([0.0, 0.0, 0.05]))
    nodes = settled(model, data, chain, 0.3)
    assert np.allclose(geometry.arc_lengths(nodes)[-1], 0.5, rtol=1e-9)  # joints cannot stretch: rounding only


@pytest.mark.parametrize("nodes", [22, 42])
def test_both_halves_of_a_held_chain_sag_as_cantilevers_do(nodes: int):
    model, data, chain = build(dataclasses.replace(STIFF_WIRE, damping_s=0.1), nodes, held=True)
    model.opt.gravity[2] = -0.05  # a sag of 0.3 % of the length: the theory assumes small deflections
    nodes_world = settled(model, data, chain, 1.5)
    sag_m = -nodes_world[[0, -1], 2]
    euler_bernoulli_m = STIFF_WIRE.mass_per_length_kg_m * 0.05 * 0.25**4 / (8 * STIFF_WIRE.bending_stiffness_n_m2)
    # A joint represents the bend of the link around it, exact except for lumped masses: 0.5 % at 21 links.
    assert sag_m == pytest.approx([euler_bernoulli_m] * 2, rel=0.01)


def test_a_chain_twists_as_stiffly_as_it_bends():
    model, data, chain = build(dataclasses.replace(STIFF_WIRE, damping_s=0.1), held=True)
    torque_nm = 1e-3
    data.xfrc_applied[model.body("chain/link_39").id, 3] = torque_nm
    settled(model, data, chain, 1.5)
    side = data.xmat[model.body("chain/link_39").id].reshape(3, 3)[:, 1]  # of the last link, which pointed along y
    joints = 19  # between the middle link, which is held, and the last
    expected_rad = torque_nm * joints * LINK_M / STIFF_WIRE.bending_stiffness_n_m2
    assert np.arctan2(side[2], side[1]) == pytest.approx(expected_rad, rel=0.001)


def test_a_bend_below_yield_springs_back():
    model, data, chain = build(WIRE)
    chain.place(arc(3.5))
    assert np.abs(curvatures(settled(model, data, chain, 3.0))).max() < 0.01


def test_a_bend_above_yield_stays_partly():
    model, data, chain = build(WIRE)
    chain.place(arc(12.0))
    kept = curvatures(settled(model, data, chain, 3.0))
    # It overshoots its rest shape and yields slightly in the other direction where it is fastest, at the ends.
    assert np.median(kept) == pytest.approx(12.0 - 4.0, rel=0.03)
    assert np.all(np.abs(kept - 8.0) < 1.0)


def test_a_chain_without_yield_always_springs_back():
    model, data, chain = build(dataclasses.replace(WIRE, yield_curvature_1_m=None))
    chain.place(arc(12.0))
    assert np.abs(curvatures(settled(model, data, chain, 3.0))).max() < 0.01


def test_placing_a_chain_again_removes_its_permanent_bends():
    model, data, chain = build(WIRE)
    chain.place(arc(12.0))
    settled(model, data, chain, 1.0)
    chain.place(arc(0.01))
    assert np.abs(curvatures(settled(model, data, chain, 2.0))).max() < 0.01


@pytest.mark.parametrize("curl_1_m", [-3.0, 3.0])
def test_a_curled_chain_laid_straight_curls_up_again(curl_1_m: float):
    model, data, chain = build(dataclasses.replace(WIRE, curl_1_m=curl_1_m))
    chain.place(arc(0.01))
    assert np.median(curvatures(settled(model, data, chain, 3.0))) == pytest.approx(curl_1_m, rel=0.01)


@pytest.mark.parametrize("curl_1_m", [-3.0, 3.0])
def test_a_curled_rod_laid_straight_curls_up_as_the_chain_does(curl_1_m: float):
    spec: Any = mujoco.MjSpec()
    elastic.set_rod_physics(spec, STEP_S)
    elastic.add_rod(spec, dataclasses.replace(STIFF_WIRE, curl_1_m=curl_1_m), NODES)
    spec.option.gravity = [0.0, 0.0, 0.0]
    model = spec.compile()
    data: Any = mujoco.MjData(model)
    elastic.set_rod_nodes(model, data, arc(0.01))
    mujoco.mj_step(model, data, nstep=round(3.0 / STEP_S))
    nodes = elastic.rod_nodes(model, data)
    assert np.median(curvatures(nodes)) == pytest.approx(curl_1_m, rel=0.01)
    assert geometry.arc_lengths(nodes)[-1] == pytest.approx(0.5, rel=0.001)


@pytest.mark.parametrize("preset", [SOFT_ROPE, WIRE], ids=["soft", "yielding"])
def test_the_energy_of_a_chain_that_nothing_drives_never_grows(preset: DloPreset):
    model, data, _ = build(preset, held=True)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    model.opt.gravity[2] = -9.81
    energies: list[float] = []
    for _ in range(400):
        mujoco.mj_step(model, data)
        energies.append(float(data.energy.sum()))
    assert max(energies) == energies[0]
    lost = energies[0] - energies[-1]
    # Gravity and spin are integrated explicitly, so that in some steps a little lost energy returns.
    assert np.diff(energies).max() < 0.01 * lost


def test_a_pushed_chain_stops_by_friction_and_then_rests():
    model, data, chain = build(SOFT_ROPE, table=True)
    chain.place(builtin_shape("I", 0.5, NODES))
    data.qvel[0] = 0.05
    after_1_s = settled(model, data, chain, 1.0)
    assert np.abs(after_1_s - builtin_shape("I", 0.5, NODES)).max() < 0.002  # measured 0.4 mm; without friction 10 cm
    assert np.abs(settled(model, data, chain, 0.5) - after_1_s).max() < 1e-5  # the rod's own bound is 1 mm in 28 s


def test_an_s_that_friction_holds_does_not_creep():
    model, data, chain = build(SOFT_ROPE, table=True)
    chain.place(builtin_shape("S", 0.5, NODES))
    after_1_s = settled(model, data, chain, 1.0)
    assert np.abs(settled(model, data, chain, 0.5) - after_1_s).max() < 1e-4  # measured below 1 um


def test_each_node_has_the_friction_at_its_position():
    model, data, chain = build(WIRE, table=True)
    model.geom_friction[model.geom("table_top").id, 0] = 0.0
    chain.set_friction(np.linspace(0.1, 0.5, NODES))
    chain.place(builtin_shape("I", 0.5, NODES))
    mujoco.mj_step(model, data, nstep=20)  # it sinks in by micrometres before it touches
    found = {round((contact.pos[1] + 0.25) / LINK_M): float(contact.friction[0]) for contact in data.contact}
    assert found == pytest.approx(dict(enumerate(np.linspace(0.1, 0.5, NODES))))


def test_a_chain_weighs_what_its_preset_says():
    model, _, _ = build(SOFT_ROPE)
    assert model.body_mass.sum() == pytest.approx(SOFT_ROPE.mass_kg)


def test_a_wrong_number_of_nodes_is_refused():
    _, _, chain = build(SOFT_ROPE)
    with pytest.raises(ConfigError, match="41"):
        chain.place(np.zeros((40, 3)))


def test_a_missing_chain_is_named():
    model = mujoco.MjSpec().compile()
    with pytest.raises(ConfigError, match="add_chain"):
        Chain(model, mujoco.MjData(model), 0.0)


@pytest.mark.parametrize(
    ("values", "says"),
    [({"yield_curvature_1_m": 0.0}, "yield-curvature-1-m"), ({"curl_1_m": 13.0}, "full circle")],
)
def test_an_invalid_preset_is_refused(values: dict[str, float], says: str):
    with pytest.raises(ConfigError, match=says):
        dataclasses.replace(SOFT_ROPE, **values)  # pyright: ignore[reportArgumentType]  # floats all
