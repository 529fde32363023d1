"""Random factors drawn from the seed, and the cell built with them."""

import dataclasses

import numpy as np
import pytest

from dlokit.description.installation import PAPERS_CELL
from dlokit.description.scene import Post
from dlokit.description.shapes import builtin_shape
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig, DloPhysics, ElasticRod, ElastoplasticChain, Factor
from dlokit.functional.cell.drawn_cell import DrawnCell, apply_drawn, draw_cell
from dlokit.functional.cell.world import TABLE_FRICTION, Cell

NOMINAL = CellConfig()
EVERYTHING = CellConfig(randomised=EVERY_FACTOR)
DRAWN: dict[Factor, str] = {
    **{"friction": "friction_factor", "stiffness": "stiffness_factor", "weight": "weight_factor"},
    **{"friction_regions": "friction_regions", "curl": "curl_1_m", "hand_eye": "hand_eye_m"},
    **{"table_tilt": "table_tilt_deg", "light": "light_factor", "color": "color_rgb"},
    "fixtures": "fixtures",
}
AMONG_POSTS = dataclasses.replace(
    PAPERS_CELL, fixtures=(Post(name="A", position_m=(0.6, 0.2, 0.0)), Post(name="B", position_m=(0.6, -0.2, 0.0)))
)


def test_nothing_is_randomised_by_default():
    assert draw_cell(NOMINAL, seed=3) == DrawnCell()
    special = CellConfig(camera_error_m=0.001)
    assert apply_drawn(special, DrawnCell()) == special


def test_a_seed_draws_the_same_factors_again_and_another_seed_others():
    assert draw_cell(EVERYTHING, 3, AMONG_POSTS) == draw_cell(EVERYTHING, 3, AMONG_POSTS)
    one, other = (dataclasses.asdict(draw_cell(EVERYTHING, seed, AMONG_POSTS)) for seed in (3, 4))
    assert [name for name in one if one[name] == other[name]] == []


@pytest.mark.parametrize("factor", EVERY_FACTOR)
def test_a_factor_is_switched_off_without_changing_the_others(factor: Factor):
    everything = dataclasses.asdict(draw_cell(EVERYTHING, 5, AMONG_POSTS))
    without = CellConfig(randomised=tuple(other for other in EVERY_FACTOR if other != factor))
    drawn = dataclasses.asdict(draw_cell(without, 5, AMONG_POSTS))
    changed = [name for name in drawn if drawn[name] != everything[name]]
    assert changed == [DRAWN[factor]]
    assert drawn[changed[0]] == getattr(DrawnCell(), changed[0])


def test_fixtures_in_the_cell_do_not_change_what_else_is_drawn():
    bare, among = draw_cell(EVERYTHING, seed=5), draw_cell(EVERYTHING, 5, AMONG_POSTS)
    assert bare.fixtures == ()
    assert dataclasses.replace(among, fixtures=()) == bare
    # Drawn before cells had fixtures.
    assert (bare.friction_factor, bare.curl_1_m, bare.table_tilt_deg[1]) == (
        1.1303906329778128,
        0.1742474471985126,
        0.05228484016449229,
    )


def test_drawn_factors_stay_within_their_ranges():
    draws = [draw_cell(EVERYTHING, seed) for seed in range(200)]
    for name, share in (("friction", 0.25), ("stiffness", 0.5), ("weight", 0.2), ("light", 0.15)):
        values = np.array([getattr(drawn, f"{name}_factor") for drawn in draws])
        assert 1 / (1 + share) <= values.min() < 1.0 < values.max() <= 1 + share
    hand_eye = np.array([drawn.hand_eye_m for drawn in draws])
    assert 0.002 <= hand_eye.min() < 0.0025
    assert 0.0045 < hand_eye.max() <= 0.005
    assert np.abs([drawn.table_tilt_deg for drawn in draws]).max() <= 0.2
    assert all(-0.5 <= drawn.curl_1_m <= 0.5 for drawn in draws if drawn.curl_1_m is not None)
    colors = np.array([drawn.color_rgb for drawn in draws])
    assert np.abs(colors - NOMINAL.dlo.color_rgb).max() <= 0.1
    assert colors.max() <= 1.0


def test_the_cell_has_the_drawn_factors():
    drawn = draw_cell(EVERYTHING, seed=5)
    cell = Cell(EVERYTHING, seed=5)
    dlo = cell.config.dlo
    assert dlo.bending_stiffness_n_m2 == NOMINAL.dlo.bending_stiffness_n_m2 * drawn.stiffness_factor
    assert dlo.mass_per_length_kg_m == NOMINAL.dlo.mass_per_length_kg_m * drawn.weight_factor
    assert (dlo.curl_1_m, dlo.color_rgb) == (drawn.curl_1_m, drawn.color_rgb)
    assert cell.drawn == drawn
    off_m = cell.rig.calibration.T_world_camera.position_m - cell.rig.true_calibration.T_world_camera.position_m
    assert np.linalg.norm(off_m) == pytest.approx(drawn.hand_eye_m)
    assert cell.config.randomised == ()


@pytest.mark.parametrize("physics", [ElasticRod(), ElastoplasticChain()], ids=lambda physics: physics.name)
def test_a_dlo_lies_flat_on_a_tilted_table(physics: DloPhysics):
    cell = Cell(CellConfig(physics=physics, settle_s=0.3), seed=0, drawn=DrawnCell(table_tilt_deg=(0.5, 0.0)))
    cell.place_dlo(builtin_shape("I", 0.5, 41)[:, :2])
    nodes = cell.true_nodes_world()
    slope = np.polyfit(nodes[:, 1], nodes[:, 2], 1)[0]
    assert slope == pytest.approx(np.tan(np.radians(0.5)), rel=0.01)
    assert np.median(nodes[:, 2]) == pytest.approx(0.004 / np.cos(np.radians(0.5)), abs=2e-5)  # 2 um deep


@pytest.mark.parametrize(
    ("physics", "felt"),
    # Half of the nodes of an I are on the left, where friction is near 0; a rod has the mean of its nodes.
    [(ElasticRod(), [0.8 * (20 + 21 * 0.1) / 41] * 41), (ElastoplasticChain(), [0.08] * 21 + [0.8] * 20)],
    ids=["rod", "chain"],
)
def test_a_dlo_has_the_friction_of_the_table_regions_it_lies_on(physics: DloPhysics, felt: list[float]):
    half_ice = DrawnCell(friction_regions=(1.0, 0.1, 1.0, 0.1))
    cell = Cell(CellConfig(physics=physics, settle_s=0.3), seed=0, drawn=half_ice)
    cell.place_dlo(builtin_shape("I", 0.5, 41) + np.array([0.0, 0.003, 0.0]))  # the middle node clearly on the left
    data = cell._data  # pyright: ignore[reportPrivateUsage]  # no skill tells contacts
    found = sorted(float(contact.friction[0]) for contact in data.contact)
    assert found == pytest.approx(felt, rel=0.001)


def test_a_table_without_regions_keeps_its_own_friction():
    cell = Cell(CellConfig(), seed=0)
    model = cell._model  # pyright: ignore[reportPrivateUsage]
    assert model.geom_friction[model.geom("table_top").id, 0] == TABLE_FRICTION
