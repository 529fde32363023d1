"""Fixtures in the cell: where they truly are, what touches them, and how hard."""

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.dlo import SOFT_ROPE, WIRE_A, DloPreset
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.description.scene import Box, Fixture, Post
from dlokit.description.shapes import builtin_shape
from dlokit.description.table import Table
from dlokit.errors import ConfigError, ShapeError
from dlokit.functional.cell.config import CellConfig, DloPhysics, ElasticRod, ElastoplasticChain
from dlokit.functional.cell.drawn_cell import FIXTURE_FRICTION, DrawnCell, DrawnFixture, draw_cell
from dlokit.functional.cell.fixtures import FixtureForces, add_fixtures, true_fixtures
from dlokit.functional.cell.surroundings import add_table, table_rotation
from dlokit.functional.cell.world import NODES, TIMESTEP_S, Cell
from dlokit.rod.elastic import set_rod_physics
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_toml, to_toml
from dlokit.types.arrays import RowArray
from dlokit.types.robot import JointTrajectory

POST = Post(name="A", position_m=(0.6, 0.2, 0.0), friction=0.2)
BLOCK = Box(name="block", position_m=(0.3, -0.2, 0.0), rpy_deg=(0.0, 0.0, 30.0), size_m=(0.05, 0.03, 0.04))
DRAWN = CellConfig(randomised=("fixtures",))


def installed(*fixtures: Fixture) -> Installation:
    return dataclasses.replace(PAPERS_CELL, fixtures=fixtures)


def parts_of(cell: Cell) -> tuple[Any, Any]:
    return cell._model, cell._data  # pyright: ignore[reportPrivateUsage]  # no skill shows shapes and contacts


def test_without_a_draw_the_fixtures_are_the_installed_ones_but_for_their_friction():
    cell = Cell(CellConfig(), seed=3, installation=installed(POST, BLOCK))
    expected = tuple(dataclasses.replace(fixture, friction=FIXTURE_FRICTION) for fixture in (POST, BLOCK))
    assert cell.fixtures == expected


def test_the_shapes_of_the_cell_are_at_the_true_poses():
    cell = Cell(DRAWN, seed=3, installation=installed(POST, BLOCK))
    model, data = parts_of(cell)
    for fixture, size_m in zip(cell.fixtures, ([0.005, 0.0125, 0.0], [0.025, 0.015, 0.02]), strict=True):
        geom = model.geom(f"fixture/{fixture.name}")
        R = data.geom_xmat[geom.id].reshape(3, 3)
        np.testing.assert_allclose(geom.size, size_m)
        np.testing.assert_allclose(R, geometry.rotation(fixture.T_world_foot), atol=1e-9)
        middle_m = fixture.corners_world.mean(axis=0)
        np.testing.assert_allclose(data.geom_xpos[geom.id], middle_m, atol=1e-9)


def test_a_drawn_pose_is_at_most_2_mm_and_1_degree_about_each_axis_from_the_installed_one():
    installation = installed(POST, BLOCK)
    off_m, off_deg, factors = [], [], []
    for seed in range(100):
        for true, believed in zip(
            true_fixtures(DRAWN, installation, draw_cell(DRAWN, seed, installation)), (POST, BLOCK), strict=True
        ):
            off_m.append(np.subtract(true.position_m, believed.position_m))
            turned = geometry.rotation(true.T_world_foot) @ geometry.rotation(believed.T_world_foot).T
            off_deg.append(np.degrees([turned[2, 1], turned[0, 2], turned[1, 0]]))
            factors.append(true.friction / FIXTURE_FRICTION)
    assert not np.any(np.array(off_m)[:, 2])  # feet stay on the table
    assert np.all(np.abs(off_m).max(axis=0)[:2] <= 0.002)
    assert np.all(np.abs(off_m).max(axis=0)[:2] > 0.0015)
    assert np.all(np.abs(off_deg).max(axis=0) <= 1.02)  # products of two small angles add up to 0.02°
    assert np.all(np.abs(off_deg).max(axis=0) > 0.8)
    assert 1 / 1.25 <= min(factors) < 0.85
    assert 1.2 < max(factors) <= 1.25


def test_a_fixture_is_drawn_alike_whatever_else_is_in_the_cell():
    alone, among = (draw_cell(DRAWN, 4, installed(*fixtures)).fixtures for fixtures in ((BLOCK,), (POST, BLOCK)))
    assert alone[0] == among[1]
    assert among[0].offset_m != among[1].offset_m


def test_fixtures_of_the_cell_replace_those_that_the_system_knows():
    moved = dataclasses.replace(POST, position_m=(0.615, 0.2, 0.0))
    cell = Cell(CellConfig(fixtures=(moved,)), seed=0, installation=installed(POST, BLOCK))
    assert cell.fixtures == (moved,)  # with its own friction
    emptied = Cell(CellConfig(fixtures=()), seed=0, installation=installed(POST, BLOCK))
    assert emptied.fixtures == ()
    assert emptied.fixture_forces is None


def test_true_fixtures_are_set_in_a_configuration_file_and_checked():
    config = RunConfig(cell=CellConfig(fixtures=(POST, BLOCK)))
    assert from_toml(to_toml(config), RunConfig, "file") == config
    assert from_toml(to_toml(RunConfig(cell=CellConfig(fixtures=()))), RunConfig, "file").cell.fixtures == ()
    assert "fixtures" not in to_toml(CellConfig())
    with pytest.raises(ConfigError, match=r"cell.fixtures: two fixtures are called A"):
        RunConfig(cell=CellConfig(fixtures=(POST, POST)))


def test_fixtures_stand_on_a_tilted_table():
    drawn = DrawnCell(table_tilt_deg=(0.2, -0.1), fixtures=(DrawnFixture(name="A", offset_m=(0.001, 0.0)),))
    post, block = true_fixtures(CellConfig(), installed(POST, BLOCK), drawn)
    tilt, centre = table_rotation(drawn.table_tilt_deg), np.array([*Table().centre_m, 0.0])
    for fixture, foot in ((post, np.array([0.601, 0.2, 0.0])), (block, np.array(BLOCK.position_m))):
        np.testing.assert_allclose(fixture.position_m, centre + tilt.apply(foot - centre), atol=1e-12)
    np.testing.assert_allclose(geometry.rotation(post.T_world_foot)[:, 2], tilt.apply([0.0, 0.0, 1.0]), atol=1e-9)


@pytest.mark.parametrize(
    ("physics", "dlo"), [(ElasticRod(), SOFT_ROPE), (ElastoplasticChain(), WIRE_A)], ids=["rod", "chain"]
)
@pytest.mark.parametrize(
    "fixture",
    [
        Post(name="A", position_m=(0.54, 0.006, 0.0), diameter_m=0.01, friction=0.1),
        Box(name="A", position_m=(0.55, 0.006, 0.0), size_m=(0.02, 0.02, 0.03), friction=0.1),
    ],
    ids=["post", "box"],
)
def test_a_dlo_dragged_at_half_a_metre_a_second_does_not_pass_through_a_fixture(
    physics: DloPhysics, dlo: DloPreset, fixture: Fixture
):
    """Both ends are pulled past the fixture by handles; the middle stays behind it."""
    spec = mujoco.MjSpec()
    set_rod_physics(spec, TIMESTEP_S)
    add_table(spec, Table(), friction=0.5)
    add_fixtures(spec, (fixture,))
    physics.add(spec, dlo, NODES)
    ends = ("rod/flex_0", f"rod/flex_{NODES - 1}") if isinstance(physics, ElasticRod) else (
        "chain/link_0", f"chain/link_{NODES - 2}")  # fmt: skip
    for end in ends:
        spec.worldbody.add_body(name=f"{end}/handle", mocap=True)
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=f"{end}/handle",
            name2=end,
        )
    model: Any = spec.compile()
    data: Any = mujoco.MjData(model)
    model.eq_data[[model.neq - 2, model.neq - 1], :6] = 0.0  # from origin to origin
    body = physics.take_over(model, data, dlo)
    body.place(builtin_shape("I", dlo.length_m, NODES, radius_m=dlo.radius_m))
    mujoco.mj_kinematics(model, data)
    handles = [model.body(f"{end}/handle").mocapid[0] for end in ends]
    data.mocap_pos[handles] = data.xpos[[model.body(end).id for end in ends]]
    touched = False
    for _ in range(round(0.3 / TIMESTEP_S)):
        data.mocap_pos[handles] += [0.5 * TIMESTEP_S, 0.0, 0.0]
        mujoco.mj_step(model, data)
        geoms = np.array(data.contact.geom)
        on_fixture = (geoms == model.geom("fixture/A").id).any(axis=1)
        touched |= bool(on_fixture.any())
        # The fixture's friction counts, though the DLO's is larger.
        assert np.allclose(data.contact.friction[on_fixture, 0], 0.1)
    mujoco.mj_kinematics(model, data)
    nodes = body.nodes_world
    assert touched
    assert nodes[[0, -1], 0].min() > 0.6  # the ends are past it
    beside = np.abs(nodes[:, 1] - 0.006) < 0.01
    assert beside.any()
    assert nodes[beside, 0].max() < fixture.position_m[0] - 0.005 - 0.8 * dlo.radius_m  # pressed in by 20 % at most


def swept(cell: Cell, turn_rad: float, duration_s: float = 1.5) -> None:
    """Turn the first joint of the first arm."""
    q = cell.arm.setpoint(cell.time_s).q_rad
    times = np.linspace(0.0, duration_s, 31)
    u = times / duration_s
    parts = (u**3 * (10 - 15 * u + 6 * u**2))[:, None] * np.array([turn_rad, *[0.0] * 6])
    dq = np.gradient(parts, times, axis=0)
    dq[[0, -1]] = 0.0
    trajectory = JointTrajectory(times_s=times, q_rad=q + parts, dq_rad_s=dq, ddq_rad_s2=np.gradient(dq, times, axis=0))
    cell.arm.start_follow(trajectory, cell.time_s)
    cell.step(duration_s + 0.3)


def test_the_force_of_an_arm_that_is_driven_into_a_post_is_noted():
    tool = Cell(CellConfig(), seed=0).arm.T_world_tcp.position_m
    # Without friction its forces are along the normals of the contacts.
    post = Post(
        name="tall",
        position_m=(tool[0], tool[1] + 0.16, 0.0),
        height_m=tool[2] + 0.3,
        diameter_m=0.02,
        friction=0.0,
    )
    cell = Cell(CellConfig(fixtures=(post, BLOCK)), seed=0)
    assert cell.fixture_forces is not None
    assert len(cell.fixture_forces) == 0
    swept(cell, 0.4)
    largest_n = forces_of(cell.fixture_forces)
    assert set(largest_n) == {("first/hand", "tall"), ("first/link6", "tall")}
    assert np.all(cell.fixture_forces["stamp_ns"] > 0.5e9)  # it touches on the way,
    assert np.all(cell.fixture_forces["stamp_ns"] < cell.time_ns)  # and comes to rest
    # At rest the first joint's torque is that of the forces about its axis, the world's z.
    model, data = parts_of(cell)
    present = FixtureForces(model, data, ["first"], cell.fixtures)
    cell.step(TIMESTEP_S)
    present.note(cell.time_ns)
    present_n = forces_of(present.rows)
    torques_nm = [
        present_n[model.body(model.geom_bodyid[geom]).name, "tall"] * np.cross(pos, frame[:3])[2]
        for (geom, other), pos, frame in zip(data.contact.geom, data.contact.pos, data.contact.frame, strict=True)
        if other == model.geom("fixture/tall").id or geom == model.geom("fixture/tall").id
    ]
    assert len(torques_nm) == 2
    assert abs(sum(torques_nm)) == pytest.approx(abs(cell.arm_state().tau_nm[0]), rel=0.02)  # it still creeps a little
    assert all(largest_n[pair] >= force_n for pair, force_n in present_n.items())
    swept(cell, -0.4)
    assert forces_of(cell.fixture_forces) == largest_n  # of the whole run


def forces_of(rows: RowArray) -> dict[tuple[str, str], float]:
    return {(row["link"], row["fixture"]): row["force_n"] for row in rows}


def test_an_arm_that_touches_no_fixture_has_no_force():
    cell = Cell(CellConfig(), seed=0, installation=installed(POST))
    swept(cell, 0.2, 0.6)
    assert cell.fixture_forces is not None
    assert len(cell.fixture_forces) == 0


def test_a_start_that_overlaps_a_true_fixture_is_refused_by_its_name():
    curve = builtin_shape("I", 0.5, 101)
    near = Post(name="near", position_m=(curve[0, 0] + 0.0105, 0.003, 0.0))
    beside = Cell(CellConfig(settle_s=0.0), seed=0, installation=installed(near))
    beside.place_dlo(curve)
    across = dataclasses.replace(near, name="across", position_m=(curve[0, 0] + 0.006, 0.003, 0.0))
    cell = Cell(CellConfig(fixtures=(across,)), seed=0, installation=installed(near))
    with pytest.raises(ShapeError, match=r"overlaps the fixture across at \[0.526, 0.003\] m: move"):
        cell.place_dlo(curve)


def test_pictures_show_fixtures_which_a_brightness_filter_does_not_take_for_a_dlo():
    config = CellConfig(dlo=dataclasses.replace(SOFT_ROPE, color_rgb=(0.0, 0.0, 0.0)), image_noise_sigma=0.0)
    bright = DrawnCell(light_factor=1.15)
    large = Box(name="block", position_m=(0.55, 0.15, 0.0), size_m=(0.1, 0.1, 0.05))
    pictures = []
    for fixtures in ((), (large, dataclasses.replace(POST, position_m=(0.5, -0.1, 0.0)))):
        cell = Cell(config, seed=0, installation=installed(*fixtures), drawn=bright)
        pictures.append(cell.capture().left)
        cell.close()
    bare, furnished = (picture.astype(np.float64).mean(axis=2) for picture in pictures)
    seen = np.abs(furnished - bare) > 5.0
    assert seen.sum() > 500
    assert furnished[seen].max() < BrightnessConfig().lowest
    assert furnished[seen].std() > 8.0  # grain for stereo matching
