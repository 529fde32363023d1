import dataclasses
import math

import mujoco
import numpy as np
import pytest

from dlokit.description.default_cameras import default_calibration
from dlokit.description.dlo import PRESETS, SOFT_ROPE, DloPreset, preset
from dlokit.description.shapes import S_RADIUS_M
from dlokit.errors import ConfigError
from dlokit.functional.cell.surroundings import table_texture
from dlokit.geometry import matrix
from dlokit.rod import elastic


def build(nodes: int = 41):
    spec = mujoco.MjSpec()
    elastic.set_rod_physics(spec, 0.0025)
    elastic.add_rod(spec, SOFT_ROPE, nodes, hangs=True)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("dlo", PRESETS, ids=lambda dlo: dlo.name)
def test_every_preset_reproduces_its_bending_stiffness(dlo: DloPreset):
    second_moment_m4 = math.pi * dlo.radius_m**4 / 4
    assert dlo.young_pa * second_moment_m4 == pytest.approx(dlo.bending_stiffness_n_m2)  # rounding only


def test_friction_holds_the_built_in_s_for_the_default_rope_with_room_to_spare():
    assert SOFT_ROPE.smallest_held_radius_m < S_RADIUS_M / 1.5


def test_an_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match="soft_rope"):
        preset("noodle")


def test_a_preset_without_stiffness_is_refused():
    with pytest.raises(ConfigError, match="bending-stiffness-n-m2 is 0"):
        dataclasses.replace(SOFT_ROPE, bending_stiffness_n_m2=0.0)


def test_too_many_nodes_are_refused_with_the_number_that_fits():
    spec = mujoco.MjSpec()
    with pytest.raises(ConfigError, match="3 to 57"):
        elastic.add_rod(spec, SOFT_ROPE, 80)


def test_nodes_are_where_they_were_put():
    model, data = build()
    wanted = np.column_stack([np.linspace(0.3, 0.6, 41), np.linspace(-0.2, 0.2, 41), np.full(41, 0.004)])
    elastic.set_rod_nodes(model, data, wanted)
    assert np.allclose(elastic.rod_nodes(model, data), wanted, atol=1e-12)  # rounding only
    mujoco.mj_forward(model, data)
    assert np.allclose(data.xpos[elastic.rod_bodies(model)], wanted, atol=1e-12)
    assert np.all(data.qvel == 0.0)


def test_a_wrong_number_of_nodes_is_refused():
    model, data = build()
    with pytest.raises(ConfigError, match="41"):
        elastic.set_rod_nodes(model, data, np.zeros((40, 3)))


def test_the_rod_weighs_what_its_preset_says():
    model, _ = build()
    # The hinges that carry the twist have inertia but next to no mass: a thousandth at most.
    assert model.body_mass[elastic.rod_bodies(model)].sum() == pytest.approx(SOFT_ROPE.mass_kg, rel=1e-3)


def test_a_rod_that_hangs_from_one_end_keeps_its_length():
    model, data = build()
    down = np.column_stack([np.zeros((41, 2)), 1.0 - np.linspace(0.0, SOFT_ROPE.length_m, 41)])
    elastic.set_rod_nodes(model, data, down)
    top = model.jnt_dofadr[model.body_jntadr[elastic.rod_bodies(model)[0]]] + np.arange(3)
    model.dof_damping[top] = 1e6  # held in place
    mujoco.mj_step(model, data, 800)
    lengthened_m = np.linalg.norm(np.diff(elastic.rod_nodes(model, data), axis=0), axis=1).sum() - SOFT_ROPE.length_m
    # A cotton rope of 8 mm lengthens by far less than 0.1 % of its length; with MuJoCo's usual impedance the edges gave
    # way by 2.3 %, with that of contacts by 0.26 %.
    assert 0.0 < lengthened_m < 0.005 * SOFT_ROPE.length_m


def test_a_missing_rod_is_named():
    with pytest.raises(ConfigError, match="add_rod"):
        elastic.rod_bodies(mujoco.MjSpec().compile())


def test_the_camera_has_the_pose_of_the_paper():
    T = matrix(default_calibration().T_world_camera)
    # PAPER.md gives the position to the millimetre and the viewed point to 1 cm.
    assert np.allclose(T[:3, 3], [0.515, 0.617, 1.011], atol=1e-3)
    on_table = T[:3, 3] + T[:3, 2] * (-T[2, 3] / T[2, 2])
    assert np.allclose(on_table, [0.571, 0.004, 0.0], atol=0.01)


def test_the_focal_length_scales_with_the_picture():
    assert default_calibration(1280, 1120).fx_px == pytest.approx(2 * default_calibration(640, 560).fx_px)


def test_the_table_is_dark_and_textured():
    texture = table_texture()
    assert texture.max() < 120  # a brightness filter at half the range must not see the table
    assert texture[:, :, 0].std() > 10  # grey levels; noise of the pictures is 1.5
