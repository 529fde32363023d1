"""A cloud without a prior: order, orientation and the named failures."""

import msgspec
import numpy as np
import pytest
from order_figures import SCENES, figures
from synthetic_clouds import LENGTH_M, NODES, cloud, hose, rod, shape

from dlokit.errors import SkillFailure
from dlokit.geometry import resample, rmse_m
from dlokit.skills.observer.initialise.first_shape import initial_targets, oriented, shown_radius_m
from dlokit.types.observation import Observation


@pytest.mark.parametrize("name", ["I", "S", "U", "random"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_nodes_are_in_order_along_the_rod(name: str, seed: int) -> None:
    truth = shape(name, seed)
    seen = cloud(truth, seed, noise_m=0.003, outliers=0.05)
    points = seen.points_world
    gap = np.linalg.norm(points - truth[8], axis=1) > 0.006  # a gap of 12 mm, as from glare
    seen = msgspec.structs.replace(seen, points_world=points[gap])
    result = initial_targets(seen, NODES, LENGTH_M, prior_nodes=truth)
    assert rmse_m(result.nodes_world, truth) < 0.005  # 3 mm noise at the tips shifts all nodes a little
    assert result.visible.all()
    assert result.health > 0.8


def test_node_0_is_the_end_farther_to_the_left() -> None:
    nodes = shape("S")
    np.testing.assert_array_equal(oriented(nodes), nodes)
    np.testing.assert_array_equal(oriented(nodes[::-1].copy()), nodes)


def test_of_two_ends_equally_far_left_node_0_is_the_one_closer_to_the_robot() -> None:
    nodes = rod(np.column_stack([np.linspace(0, 1, 50), np.zeros(50)]))
    np.testing.assert_array_equal(oriented(nodes[::-1].copy()), nodes)


def test_a_prior_decides_the_order() -> None:
    nodes = shape("S")
    np.testing.assert_array_equal(oriented(nodes, nodes[::-1] + 0.02), nodes[::-1])


def failure(seen_nodes: np.ndarray, **settings: object) -> str:
    with pytest.raises(SkillFailure) as failed:
        initial_targets(cloud(seen_nodes, **settings), NODES, LENGTH_M)  # type: ignore[arg-type]  # one test helper
    return failed.value.reason


def loop(tail: int) -> np.ndarray:
    """A straight piece, most of a circle, and a straight piece that crosses the first."""
    turn = 2 * np.pi * 0.85
    heading = np.concatenate([np.zeros(tail), np.linspace(0.0, turn, 200), np.full(tail, turn)])
    return rod(np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0), 101)


def ring() -> np.ndarray:
    a = np.linspace(0.0, 2 * np.pi, 200)
    return rod(np.column_stack([np.cos(a), np.sin(a)]), 101)


def eight() -> np.ndarray:
    a = np.linspace(0.2, 0.2 + 1.9 * np.pi, 300)
    return rod(np.column_stack([np.sin(a), 0.6 * np.sin(2 * a)]), 101)


@pytest.mark.parametrize("nodes", [loop(40), loop(70), eight()], ids=["loop", "tails", "eight"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_rod_across_itself_continues_straight_at_the_crossing(nodes: np.ndarray, seed: int) -> None:
    result = initial_targets(cloud(nodes, seed), NODES, LENGTH_M)
    assert rmse_m(result.nodes_world, resample(nodes, NODES), ends_interchangeable=True) < 0.006


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_ring_has_no_first_node(seed: int) -> None:
    assert failure(ring(), seed=seed) == "crossing"


def test_too_few_points_are_named() -> None:
    assert failure(shape("S"), count=30) == "no_points"
    assert failure(shape("S"), count=0) == "no_points"


def test_an_end_that_is_cut_off_is_named() -> None:
    assert failure(shape("S"), hidden=(0.8, 1.0)) == "out_of_view"


def test_pieces_far_apart_are_named() -> None:
    assert failure(shape("I"), hidden=(0.4, 0.6)) == "fragmented"


@pytest.mark.parametrize("name", SCENES)
def test_rods_with_crossings_gaps_and_outliers_are_ordered_correctly_or_refused(name: str) -> None:
    # order_figures.py prints the full statistics; here are a few seeds, of which one may be refused.
    found = figures(SCENES[name], range(20, 23 if SCENES[name].crossings > 1 else 28))
    assert found.right > 0.8
    assert found.wrong == 0.0


def test_nodes_in_a_gap_are_not_visible() -> None:
    result = initial_targets(cloud(shape("I"), hidden=(0.5, 0.6)), NODES, LENGTH_M)
    assert rmse_m(result.nodes_world, shape("I")) < 0.005
    # 5 cm are hidden; nodes within 15 mm of seen points still have support.
    assert np.flatnonzero(~result.visible).tolist() == [16, 17]


def centred_m(radius_mm: int) -> float:
    """The largest error of nodes that lie in the middle of a hose: a quarter of its radius, and the noise [m]."""
    return 0.25 * radius_mm / 1000.0 + 0.001


@pytest.mark.parametrize("radius_mm", [1, 4, 7, 8, 12, 20])
def test_a_dlo_of_any_thickness_is_ordered_at_its_radius(radius_mm: int) -> None:
    line, seen = hose(radius_mm / 1000.0)
    found = initial_targets(seen, NODES, 1.0, radius_m=radius_mm / 1000.0)
    truth = resample(line, NODES)[:, :2]
    assert rmse_m(found.nodes_world[:, :2], truth, ends_interchangeable=True) < centred_m(radius_mm)
    assert found.visible.all()
    assert found.health > 0.95


@pytest.mark.parametrize("radius_mm", [8, 20])
def test_a_dlo_that_is_thicker_than_given_is_ordered_at_the_radius_that_it_shows(radius_mm: int) -> None:
    line, seen = hose(radius_mm / 1000.0)
    assert shown_radius_m(seen.points_world.astype(np.float64)) == pytest.approx(radius_mm / 1000.0, rel=0.15)
    found = initial_targets(seen, NODES, 1.0)
    truth = resample(line, NODES)[:, :2]
    assert rmse_m(found.nodes_world[:, :2], truth, ends_interchangeable=True) < centred_m(radius_mm)


def hairpin(bend_m: float) -> np.ndarray:
    """Two straight strands, `2 bend_m` apart, and the half circle that joins them (42, 2) [m]; 1 m long."""
    turn, tail_m = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 40), (1.0 - np.pi * bend_m) / 2.0
    bend = bend_m * np.column_stack((np.cos(turn), np.sin(turn)))
    return np.vstack(([-tail_m, -bend_m], bend, [-tail_m, bend_m]))


@pytest.mark.parametrize(("bend_m", "said"), [(0.021, "wider than a DLO of 40 mm"), (0.03, "fragmented|crossing")])
def test_strands_side_by_side_are_no_thicker_dlo_where_the_radius_is_given(bend_m: float, said: str) -> None:
    _, seen = hose(0.02, along_xy=hairpin(bend_m))
    with pytest.raises(SkillFailure, match=said):
        initial_targets(seen, NODES, None, radius_m=0.02, given=True)
    with pytest.raises(SkillFailure, match="m long rod are seen"):
        initial_targets(seen, NODES, 1.0, radius_m=0.02, given=True)


def test_a_hose_of_given_radius_and_unknown_length_is_ordered() -> None:
    line, seen = hose(0.02)
    found = initial_targets(seen, NODES, None, radius_m=0.02, given=True)
    assert rmse_m(found.nodes_world[:, :2], resample(line, NODES)[:, :2], ends_interchangeable=True) < centred_m(20)


def test_a_thinner_dlo_is_ordered_as_the_usual_one_to_the_bit() -> None:
    usual, thinner = (initial_targets(cloud(shape("S")), NODES, LENGTH_M, radius_m=r) for r in (0.004, 0.001))
    np.testing.assert_array_equal(usual.nodes_world, thinner.nodes_world)


def test_an_area_shows_no_radius() -> None:
    assert shown_radius_m(np.random.default_rng(0).uniform(0.0, [0.6, 0.4, 0.004], (5000, 3))) == 0.0


def test_an_area_is_refused() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([0.2, -0.4, 0.0], [0.8, 0.4, 0.004], (20_000, 3))
    table = Observation(stamp_ns=1, points_world=points.astype(np.float32))
    with pytest.raises(SkillFailure) as failed:
        initial_targets(table, NODES, LENGTH_M)
    assert failed.value.reason == "fragmented"
