import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlokit.description import shapes
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ConfigError, ShapeError
from dlokit.extras.bench.shaping.experiments import BentGoal, CurveGoal
from dlokit.extras.bench.shaping.suites import (
    SUITE_NAMES,
    VERSION,
    fingerprint,
    goals_suite,
    paper_suite,
    stiffness_suite,
    suite_of,
    wires_suite,
)
from dlokit.functional.cell.config import EVERY_FACTOR, ElastoplasticChain
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml

FROZEN = {
    "version": 2,
    "paper": "fcb09ee4757c",
    "stiffness": "28ec18e5eb7a",
    "wires": "d2ea89d2b1b5",
    "posts": "bb907055e152",
    "pegs": "1698cf1d9d85",
    "cell": "f2917e6bf595",
}
"""Fingerprints of the suites and of the randomised cell's settings.

They last changed within a version when experiments could have fixtures, and their errors could be drawn: without
fixtures, this leaves every run as it was.
"""


def test_the_suites_are_those_of_their_version() -> None:
    cell = to_toml(replace(RunConfig().cell, randomised=EVERY_FACTOR))
    now = {
        "version": VERSION,
        **{name: fingerprint(suite_of(name, None)) for name in SUITE_NAMES if name != "goals"},
        "cell": hashlib.sha256(cell.encode()).hexdigest()[:12],
    }
    assert now == FROZEN, "reported figures are no longer comparable: raise VERSION, and record the fingerprints"


def _on_table(nodes: np.ndarray) -> bool:
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    return bool(low[0] >= x0 and high[0] <= x1 and low[1] >= y0 and high[1] <= y1)


def test_every_start_and_goal_of_the_suites_lies_on_the_table_at_the_rods_length() -> None:
    config = RunConfig()
    for experiment in (*paper_suite(), *stiffness_suite(), *wires_suite()):
        run = experiment.configured(config)
        goal = experiment.goal.nodes_world(run.model.length_m, run.model.radius_m)
        start = experiment.start_world(run.cell.dlo, experiment.seed_offset)
        for nodes in (goal, start):
            assert _on_table(nodes), experiment.name
            # A polyline of 100 pieces cuts corners of 6 cm by (5 mm)² / (24 · (6 cm)²): 0.03 %.
            assert shapes.length(nodes) == pytest.approx(run.cell.dlo.length_m, rel=1e-3)


def test_the_paper_suite_has_its_five_experiments() -> None:
    names = [experiment.name for experiment in suite_of("paper", None)]

    assert names == ["I to S", "S to I", "I to I", "random to I", "random to S"]


def test_the_rods_of_the_stiffness_suite_have_their_limit_at_the_ratio_of_the_goals_radius() -> None:
    for experiment in stiffness_suite():
        assert isinstance(experiment.goal, BentGoal)
        assert experiment.dlo is not None
        ratio = float(experiment.name.split()[0])
        assert experiment.dlo.smallest_held_radius_m == pytest.approx(ratio * experiment.goal.bend_radius_m)
        assert f"{'up to' if ratio <= 0.9 else 'above'} 0.9 of the limit" in experiment.groups


@pytest.mark.parametrize("turn_deg", [60, 90, 180])
def test_each_arc_of_a_bent_goal_turns_by_its_angle_at_its_radius(turn_deg: int) -> None:
    radius_m = 0.07
    nodes = BentGoal(turn_rad=np.deg2rad(turn_deg), bend_radius_m=radius_m).nodes_world(0.5, 0.004)

    steps = np.diff(nodes[:, :2], axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    # The heading between two nodes is known at the middle of a piece: up to half a step of bend is missing.
    assert np.ptp(headings) == pytest.approx(np.deg2rad(turn_deg), abs=0.005 / radius_m)
    bends = np.abs(np.diff(headings)) / (0.5 / (len(nodes) - 1))
    assert bends.max() == pytest.approx(1.0 / radius_m, rel=0.02)


def test_the_system_is_configured_with_measured_and_not_true_parameters() -> None:
    stiff = stiffness_suite()[-1].configured(RunConfig())
    wire = wires_suite()[0].configured(RunConfig())

    assert stiff.model.bending_stiffness_n_m2 == pytest.approx(1.3 * stiff.cell.dlo.bending_stiffness_n_m2)
    assert stiff.model.friction != stiff.cell.dlo.friction
    assert stiff.model.belief.takes_set == 0.0
    assert wire.model.belief.takes_set > 0.0
    assert wire.model.bending_stiffness_n_m2 == RunConfig().model.bending_stiffness_n_m2
    assert wire.model.radius_m == wire.cell.dlo.radius_m
    assert isinstance(wire.cell.physics, ElastoplasticChain)


def test_curves_of_a_file_are_scaled_moved_to_the_middle_and_have_seeds_of_their_own(tmp_path: Path) -> None:
    arcs = np.linspace(0.0, 1.0, 10)
    file = tmp_path / "goals.npy"
    np.save(file, np.stack([np.column_stack([0.2 * arcs, k * arcs**2, 0.0 * arcs]) for k in (0.0, 0.1)]))

    straight, bent = goals_suite(file)

    assert isinstance(bent.goal, CurveGoal)
    nodes = bent.goal.nodes_world(0.5, 0.004)
    assert shapes.length(nodes) == pytest.approx(0.5, rel=1e-3)  # resampling cuts the corners of ten points
    middle = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2
    assert middle == pytest.approx(shapes.CENTRE_M)
    assert nodes[:, 2] == pytest.approx(0.004)
    assert straight.seed_offset != bent.seed_offset
    assert not np.array_equal(
        straight.start_world(RunConfig().cell.dlo, straight.seed_offset),
        bent.start_world(RunConfig().cell.dlo, bent.seed_offset),
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.zeros((2, 3)), "not an array"),
        (np.zeros((0, 4, 3)), "is required"),
        (np.zeros((1, 4, 3)), "has no length"),
        (np.full((1, 4, 3), np.nan), "has no length"),
    ],
)
def test_a_file_without_curves_is_one_clear_error(tmp_path: Path, content: np.ndarray, message: str) -> None:
    np.save(tmp_path / "goals.npy", content)

    with pytest.raises(ShapeError, match=message):
        suite_of("goals", tmp_path / "goals.npy")


def test_a_suite_and_its_file_must_fit() -> None:
    with pytest.raises(ConfigError, match="needs a file"):
        suite_of("goals", None)
    with pytest.raises(ConfigError, match="takes no file"):
        suite_of("paper", Path("goals.npy"))
    with pytest.raises(ConfigError, match="paper, goals, stiffness, wires"):
        suite_of("papers", None)
