import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from dlokit.description.dlo import WIRE_A
from dlokit.description.shapes import builtin_shape, random_shape
from dlokit.errors import ConfigError, DlokitError, ShapeError
from dlokit.functional.cell.config import CellConfig, ElastoplasticChain
from dlokit.functional.cell.world import NODES, Cell
from dlokit.geometry import rmse_m
from dlokit.rod.elastic import rod_bodies
from dlokit.types.arrays import Float64Array

CONFIG = CellConfig()


def start_shapes() -> Iterator[tuple[str, Float64Array]]:
    yield "I", builtin_shape("I", 0.5, 200)
    yield "S", builtin_shape("S", 0.5, 200)
    yield "random", random_shape(np.random.default_rng(3), 0.5, 200)


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("name", "curve"), list(start_shapes()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_a_shape_at_rest_moves_less_than_a_millimetre_from_2_to_30_s(name: str, curve: np.ndarray):
    cell = Cell(CONFIG, seed=0)
    cell.place_dlo(curve)  # settles for 2 s
    before = cell.true_nodes_world()
    cell.step(28.0)
    moved_m = np.linalg.norm(cell.true_nodes_world() - before, axis=1).max()
    assert moved_m < 1e-3  # the bound; measured 0.02 mm


def test_a_chain_at_rest_lies_as_still_as_the_rod():
    cell = Cell(CellConfig(physics=ElastoplasticChain()), seed=0)
    cell.place_dlo(builtin_shape("S", 0.5, 200))
    before = cell.true_nodes_world()
    cell.step(3.0)
    assert np.linalg.norm(cell.true_nodes_world() - before, axis=1).max() < 1e-4  # measured 2 um in a second


def test_a_wire_keeps_an_s_that_an_elastic_rod_of_equal_stiffness_does_not():
    curve = builtin_shape("S", 0.5, 41, radius_m=WIRE_A.radius_m)
    away_m: list[float] = []
    for yield_1_m in (WIRE_A.yield_curvature_1_m, None):
        dlo = dataclasses.replace(WIRE_A, yield_curvature_1_m=yield_1_m)
        cell = Cell(CellConfig(dlo=dlo, physics=ElastoplasticChain()), seed=0)
        cell.place_dlo(curve)
        away_m.append(rmse_m(cell.true_nodes_world(), curve))
    assert away_m[0] < 0.002  # measured 0.5 mm
    assert away_m[1] > 0.03  # measured 53 mm


def test_a_start_shape_stays_close_to_the_requested_one():
    cell = Cell(CONFIG, seed=0)
    curve = builtin_shape("S", 0.5, NODES)
    cell.place_dlo(curve)
    # Friction holds an S except for its first elastic slip; a task ends at 12 mm.
    assert np.linalg.norm(cell.true_nodes_world() - curve, axis=1).max() < 0.006


def test_cells_of_one_seed_are_equal_to_the_bit():
    def run() -> bytes:
        cell = Cell(CONFIG, seed=5)
        cell.place_dlo(builtin_shape("S", 0.5, 200))
        cell.arm.fingers.start_grip(0.02, 20.0)
        cell.step(0.5)
        state = cell.arm_state()
        return (
            cell.true_nodes_world().tobytes()
            + state.q_rad.tobytes()
            + cell.rig.calibration.T_world_camera.wxyz.tobytes()
        )

    assert run() == run()


def test_placing_the_rope_takes_no_time():
    cell = Cell(CONFIG, seed=0)
    cell.begin_at(7)
    cell.place_dlo(builtin_shape("I", 0.5, 200))
    assert cell.time_ns == 7
    cell.step(0.01)
    assert cell.time_ns == 10_000_007


@pytest.mark.parametrize(
    ("curve", "says"),
    [
        ([[0.4, 0.0], [0.6, 0.0]], "0.200 m long"),
        ([[0.4, 0.0, 0.0, 0.0]], r"\(K, 2\) or \(K, 3\)"),
        ([[1.0, 0.0], [1.5, 0.0]], "leaves the table"),
        ([[0.0, 0.0], [np.nan, 0.5]], "long"),
    ],
)
def test_an_invalid_start_shape_is_refused_by_name(curve: list[list[float]], says: str):
    cell = Cell(CONFIG, seed=0)
    with pytest.raises(ShapeError, match=says):
        cell.place_dlo(curve)


def test_the_arm_state_does_not_contain_the_rope():
    """The arm's state is independent of the rope's position."""
    states = []
    for name in ("I", "S"):
        cell = Cell(CONFIG, seed=0)
        cell.place_dlo(builtin_shape(name, 0.5, 200))
        cell.step(0.05)
        states.append(cell.arm_state())
    a, b = states
    for field in ("q_rad", "dq_rad_s", "tau_nm"):
        assert np.allclose(getattr(a, field), getattr(b, field), atol=1e-9)  # rounding of one solver
    assert np.allclose(a.T_world_tcp.position_m, b.T_world_tcp.position_m, atol=1e-9)


def test_a_pushed_rope_does_not_roll_away():
    cell = Cell(CONFIG, seed=0)
    cell.place_dlo(builtin_shape("I", 0.5, 200))
    before = cell.true_nodes_world()
    model, data = cell._model, cell._data  # pyright: ignore[reportPrivateUsage]  # no skill can push a rope
    data.qvel[model.jnt_dofadr[model.body_jntadr[rod_bodies(model)]]] = 0.05
    cell.step(1.0)
    moved_m = np.abs(cell.true_nodes_world() - before)[:, 0].max()
    # Sliding friction and the resistance to rolling stop it within 0.4 mm; without the latter it rolls 3.4 mm.
    assert moved_m < 0.001


def test_a_diverged_cell_is_reported_and_not_reset():
    cell = Cell(CONFIG, seed=0)
    cell._data.qvel[0] = np.nan  # pyright: ignore[reportPrivateUsage]  # nothing that one may do does this
    with pytest.raises(DlokitError, match="diverged"):
        cell.step(0.01)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"width_px": 8}, "width-px is 8; it must be 64 or greater"),
        ({"camera_error_m": -1.0}, "camera-error-m"),
        ({"image_noise_sigma": float("nan")}, "image-noise-sigma"),
        ({"real_time_factor": 0.0}, "real-time-factor"),
        ({"randomised": ("friction", "colour")}, "randomised"),
    ],
)
def test_invalid_settings_are_refused_by_name(values: dict[str, Any], says: str):
    with pytest.raises(ConfigError, match=says):
        CellConfig(**values)
