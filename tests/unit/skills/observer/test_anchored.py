"""Ordered node error, the quantity that convergence is judged by."""

import msgspec
import numpy as np
import pytest
from synthetic_clouds import LENGTH_M, cloud, shape, state

from dlokit.geometry import resample, rmse_m
from dlokit.skills.observer.anchored import Anchored, chain, is_chain
from dlokit.skills.observer.cpd import PLIABLE, Cpd
from dlokit.types.dlo import Topology
from dlokit.types.observation import GripperPin

SHAPES = ["I", "S", "U", "random"]


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", [1, 2])
def test_nodes_have_their_positions_on_a_fully_visible_rod(name: str, seed: int) -> None:
    rod = shape(name, seed)
    prior = rod + np.array([0.02, 0.02, 0.0])  # 2.8 cm since the last cloud
    result = Anchored().estimate(cloud(rod, seed), state(prior))
    assert rmse_m(result.nodes_world, rod) < 0.004  # the bar of the case: 2 mm noise, 3 % outliers
    assert result.visible.all()
    assert result.health > 0.9


def test_anchoring_is_what_keeps_nodes_from_sliding() -> None:
    rod = shape("S")
    prior = state(resample(rod, 31) + np.array([0.0, 0.03, 0.0]))  # 3 cm along the rod
    seen = cloud(rod)
    assert rmse_m(Cpd(PLIABLE).estimate(seen, prior).nodes_world, rod) > 0.008
    assert rmse_m(Anchored().estimate(seen, prior).nodes_world, rod) < 0.004


def test_the_ends_never_flip_while_the_rod_moves_three_centimetres_per_cloud() -> None:
    rod = shape("random", 3)
    nodes = rod
    for frame in range(1, 13):
        turn = 0.1 * frame
        R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        truth = (rod - rod.mean(axis=0)) @ R.T + rod.mean(axis=0) + [0.02 * frame, 0.01 * frame, 0.0]
        nodes = Anchored().estimate(cloud(truth, frame), state(nodes)).nodes_world
        assert rmse_m(nodes, truth) < 0.004, f"cloud {frame}"


@pytest.mark.parametrize("name", SHAPES)
def test_a_hidden_middle_stays_coherent_and_does_not_count_as_visible(name: str) -> None:
    rod = shape(name, 4)
    result = Anchored().estimate(cloud(rod, hidden=(0.4, 0.6)), state(rod + np.array([0.01, 0.0, 0.0])))
    assert rmse_m(result.nodes_world, rod) < 0.010
    assert not result.visible[14:17].any()
    assert result.visible[:11].all()
    assert result.visible[20:].all()


@pytest.mark.parametrize("name", SHAPES)
def test_a_hidden_end_is_anchored_by_the_other_tip(name: str) -> None:
    rod = shape(name, 5)
    result = Anchored().estimate(cloud(rod, hidden=(0.75, 1.0)), state(rod + np.array([0.01, 0.0, 0.0])))
    assert rmse_m(result.nodes_world, rod) < 0.010  # as for a hidden middle
    assert not result.visible[26:].any()
    assert result.visible[:22].all()


def test_a_hidden_end_is_carried_along_by_the_rest_of_the_rod() -> None:
    rod = shape("I")
    moved = rod + np.array([0.03, 0.0, 0.0])
    result = Anchored().estimate(cloud(moved, hidden=(0.75, 1.0)), state(rod))
    # It is hidden; its position follows from the motion of the visible part, 3 cm along x.
    np.testing.assert_allclose(result.nodes_world[26:], moved[26:], atol=0.006)


def test_a_held_node_is_where_the_gripper_is_and_anchors_what_shows_no_tip() -> None:
    rod = shape("S")
    pin = GripperPin(robot="first", node=15, position_world=rod[15].astype(np.float32))
    seen = cloud(rod, hidden=(0.85, 1.0))
    points = seen.points_world
    no_first = np.linalg.norm(points - rod[0], axis=1) > 0.08  # the other tip is hidden too
    near_pin = np.linalg.norm(points - rod[15], axis=1) < 0.015  # in the shadow of the fingers
    seen = msgspec.structs.replace(seen, points_world=points[no_first & ~near_pin], pins=(pin,))
    slid = state(resample(rod, 31) + np.array([0.0, 0.025, 0.0]))
    result = Anchored().estimate(seen, slid)
    np.testing.assert_allclose(result.nodes_world[15], rod[15], atol=1e-6)  # float32 of the message
    assert rmse_m(result.nodes_world[5:26], rod[5:26]) < 0.004


def test_a_cloud_that_is_not_a_rod_gives_zero_health() -> None:
    dust = np.random.default_rng(0).uniform([0.3, -0.3, 0.0], [0.7, 0.3, 0.1], (1500, 3))
    seen = msgspec.structs.replace(cloud(shape("I")), points_world=dust.astype(np.float32))
    assert Anchored().estimate(seen, state(shape("S"))).health < 0.5


def test_a_branched_topology_is_registered_without_anchors() -> None:
    rod = shape("I")
    plain = chain(len(rod), LENGTH_M)
    edges = plain.edges.copy()
    edges[-1, 0] = 10
    branched = Topology(edges=edges, rest_lengths_m=plain.rest_lengths_m)
    assert is_chain(plain)
    assert not is_chain(branched)
    prior = msgspec.structs.replace(state(rod), topology=branched)
    np.testing.assert_array_equal(
        Anchored().estimate(cloud(rod), prior).nodes_world, Cpd(PLIABLE).estimate(cloud(rod), prior).nodes_world
    )


def test_an_empty_cloud_returns_the_prior_with_zero_health() -> None:
    rod = shape("S")
    result = Anchored().estimate(cloud(rod, count=0), state(rod))
    np.testing.assert_array_equal(result.nodes_world, rod)
    assert not result.visible.any()
    assert result.health == 0.0
