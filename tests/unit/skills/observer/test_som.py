"""The self-organising map compared with its definition, and its accuracy."""

import msgspec
import numpy as np
import pytest
from synthetic_clouds import NODES, cloud, rod, shape, state

from dlokit.geometry import resample, rmse_m
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.compiled import winners
from dlokit.skills.observer.som import (
    Som,
    SomConfig,
    batch_update,
    carried,
    graph_distances,
    neighbourhood,
    organise,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import Topology


def spiral(turns: float = 1.0) -> Float64Array:
    """Turning inwards, to a third of the radius."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 800)
    radius = 1.0 - 0.7 * angle / angle[-1]
    return rod(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


def unwound(nodes: Float64Array, share: float) -> Float64Array:
    """The curve with only a `share` (fraction) of its bend, around the same centre."""
    steps = np.diff(nodes[:, :2], axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    heading = heading.mean() + share * (heading - heading.mean())
    length = np.linalg.norm(steps, axis=1)[:, None]
    xy = np.vstack([[0.0, 0.0], np.cumsum(length * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)])
    return np.column_stack([xy - xy.mean(axis=0), np.zeros(len(xy))]) + nodes.mean(axis=0)


def step(X: Float64Array, T: Float64Array, h: Float64Array, gate_m: float) -> Float64Array:
    winner, distance_m = winners(X, T)
    return batch_update(X, T, h, winner, distance_m < gate_m)


def test_the_batch_update_is_its_definition() -> None:
    T = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    X = np.array([[0.1, 0.2, 0.0], [-0.1, 0.0, 0.0], [1.1, 0.0, 0.1], [0.9, 9.0, 0.0]])
    d = graph_distances(chain(3, 2.0), 3)
    h = neighbourhood(d, 0.8)
    expected = np.zeros((3, 3))
    for i in range(3):
        weights = [np.exp(-((i - c) ** 2) / (2 * 0.8**2)) for c in (0, 0, 1)]  # winners 0, 0, 1; the last too far
        expected[i] = sum(w * x for w, x in zip(weights, X, strict=False)) / sum(weights)
    np.testing.assert_allclose(step(X, T, h, 1.5), expected, atol=1e-12)  # written out: rounding only


def test_a_neuron_that_no_point_reaches_stays() -> None:
    T = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
    after = step(np.array([[0.1, 0.0, 0.0]]), T, neighbourhood(graph_distances(chain(3, 9.0), 3), 0.1), 1.0)
    np.testing.assert_allclose(after, [[0.1, 0.0, 0.0], [1.0, 0.0, 0.0], [9.0, 0.0, 0.0]], atol=1e-12)


def test_neighbours_are_along_the_branches_and_not_across() -> None:
    edges = np.array([[0, 1], [1, 2], [1, 3], [4, 5]])
    d = graph_distances(Topology(edges=edges, rest_lengths_m=np.full(4, 0.1)), 6)
    np.testing.assert_array_equal(d[0, :4], [0, 1, 2, 2])
    np.testing.assert_array_equal(d, d.T)
    assert np.isinf(d[0, 4])  # another piece
    np.testing.assert_array_equal(neighbourhood(d, 1.0)[0, 4:], 0.0)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_it_converges_on_a_spiral_from_a_prior_that_is_almost_straight(share: float) -> None:
    curve = spiral()
    prior = unwound(curve, share)
    assert rmse_m(prior, curve) > 0.07  # a fifth, or half, of the bend: far away
    result = Som().estimate(cloud(curve), state(prior))
    # Nodes spread as evenly as the points, a tip's node half a spacing inside: in all less than a spacing, 16.7 mm.
    assert rmse_m(result.nodes_world, curve) < 0.0167
    distances = np.linalg.norm(result.nodes_world[:, None] - resample(curve, 600)[None], axis=2)
    assert np.all(np.diff(np.argmin(distances, axis=1)) > 0)
    distance = distances.min(axis=1)
    assert np.sqrt(np.mean(distance**2)) < 0.002  # the noise of the points, of which 22 make a node's mean


@pytest.mark.parametrize("turns", [1.5, 2.0])
def test_in_a_tight_coil_it_converges_only_from_a_nearby_prior(turns: float) -> None:
    curve = spiral(turns)
    prior = unwound(curve, 0.95)
    # Turns are about 2 cm apart. From 8 tenths of the bend, or of 2.5 turns, it ends on the wrong turn:
    # there, the prior's nodes are about as near to the next turn as to their own.
    assert rmse_m(Som().estimate(cloud(curve), state(prior)).nodes_world, curve) < 0.0167  # a spacing


def test_a_neighbourhood_wider_than_the_error_would_fold_the_map() -> None:
    curve, d = spiral(2.0), graph_distances(chain(NODES, 0.5), NODES)
    points = cloud(curve, outliers=0.0).points_world.astype(np.float64)
    wide = organise(
        points, unwound(curve, 0.95), d, 0.5 / 30, SomConfig(misfit_fraction=1.0, gate_m=1.0, final_radius=3.0)
    )
    fitting = organise(points, unwound(curve, 0.95), d, 0.5 / 30, SomConfig())
    assert rmse_m(wide, curve) > 2.0 * rmse_m(fitting, curve)


@pytest.mark.parametrize("name", ["I", "S", "U", "random"])
@pytest.mark.parametrize("seed", [1, 2])
def test_nodes_keep_their_order_along_the_rod(name: str, seed: int) -> None:
    curve = shape(name, seed)
    nodes = Som().estimate(cloud(curve, seed), state(curve + np.array([0.015, 0.015, 0.0]))).nodes_world
    dense = resample(curve, 1000)
    place = np.argmin(np.linalg.norm(nodes[:, None] - dense[None], axis=2), axis=1)
    assert np.all(np.diff(place) > 0)


def test_the_neighbourhood_is_what_keeps_nodes_evenly_spread() -> None:
    curve = spiral()
    prior = unwound(curve, 0.2)
    d = graph_distances(chain(NODES, 0.5), NODES)
    points = cloud(curve, outliers=0.0).points_world.astype(np.float64)
    alone = organise(points, prior, d, 0.5 / 30, SomConfig(initial_radius=0.05, final_radius=0.05))
    together = organise(points, prior, d, 0.5 / 30, SomConfig())
    spread = [np.linalg.norm(np.diff(nodes, axis=0), axis=1).std() for nodes in (alone, together)]
    assert spread[1] < 0.5 * spread[0]


@pytest.mark.parametrize(("hidden", "gone"), [((0.4, 0.6), slice(13, 18)), ((0.75, 1.0), slice(25, 31))])
def test_a_hidden_part_is_not_pulled_to_the_rest(hidden: tuple[float, float], gone: slice) -> None:
    curve = shape("S")
    result = Som().estimate(cloud(curve, hidden=hidden), state(curve + np.array([0.015, 0.0, 0.0])))
    assert not result.visible[gone].any()
    # A map of all nodes has errors of 20 mm (middle) and 58 mm (tip); half a spacing at the rims remains.
    assert rmse_m(result.nodes_world, curve) < 0.015
    np.testing.assert_allclose(result.nodes_world[gone], curve[gone], atol=0.025)


def test_hidden_nodes_move_as_the_nearest_visible_ones_along_the_dlo() -> None:
    Y = rod(np.column_stack([np.linspace(0.0, 1.0, 9), np.zeros(9)]), 9)
    T = Y.copy()
    T[:3] += [0.0, 0.01, 0.0]
    T[6:] += [0.0, 0.03, 0.0]
    shown = np.array([True] * 3 + [False] * 3 + [True] * 3)
    moved = (carried(Y, T, shown, graph_distances(chain(9, 0.5), 9), 1.0) - Y)[:, 1]
    np.testing.assert_allclose(moved[shown], (T - Y)[shown, 1])
    assert 0.01 < moved[3] < moved[4] < moved[5] < 0.03
    np.testing.assert_allclose(moved[4], 0.02, atol=1e-9)  # the middle, as near to the one side as to the other


def test_a_completely_hidden_branch_stays() -> None:
    edges = np.array([[0, 1], [2, 3]])
    d = graph_distances(Topology(edges=edges, rest_lengths_m=np.full(2, 0.1)), 4)
    Y = np.zeros((4, 3))
    moved = carried(Y, Y + 0.01, np.array([True, False, False, False]), d, 1.0)
    np.testing.assert_allclose(moved, [[0.01] * 3, [0.01] * 3, [0.0] * 3, [0.0] * 3])


def test_far_points_have_no_effect() -> None:
    curve = shape("S")
    seen = cloud(curve, outliers=0.0)
    far = np.random.default_rng(0).uniform([0.2, 0.4, 0.0], [0.6, 0.6, 0.1], (300, 3))
    dirty = msgspec.structs.replace(seen, points_world=np.vstack([seen.points_world, far]).astype(np.float32))
    all_points = SomConfig(max_points=5000)
    clean_nodes = Som(all_points).estimate(seen, state(curve)).nodes_world
    np.testing.assert_allclose(Som(all_points).estimate(dirty, state(curve)).nodes_world, clean_nodes, atol=1e-9)


def test_an_empty_cloud_returns_the_prior_with_zero_health() -> None:
    curve = shape("S")
    result = Som().estimate(cloud(curve, count=0), state(curve))
    np.testing.assert_array_equal(result.nodes_world, curve)
    assert not result.visible.any()
    assert result.health == 0.0


def test_a_long_edge_separates_nodes_more_than_a_short_one() -> None:
    d = graph_distances(Topology(edges=chain(3, 0.3).edges, rest_lengths_m=np.array([0.1, 0.3])), 3)
    np.testing.assert_allclose(d[0], [0.0, 0.5, 2.0])  # the mean edge is 0.2 m
