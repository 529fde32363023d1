"""`dlokit.Tracker`: clouds in, nodes out, alike to the observer of a full system."""

import os
from itertools import pairwise

import numpy as np
import pytest

from dlokit.app.library import tracker as tracking
from dlokit.app.library.tracker import Tracker
from dlokit.errors import InputError, MachineError
from dlokit.geometry import resample, rmse_m
from dlokit.geometry.poses import matrix, pose, transform
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import nothing_seen, prior_from
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.observer.strategies import OURS
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import DistrustReason, Observation

LENGTH_M = 0.42


def bow(shift_m: float) -> Float64Array:
    """A bow on the table, node 0 at larger y, (31, 3) [m]."""
    y = np.linspace(0.2, -0.2, 400)
    return resample(np.column_stack([0.5 + shift_m - 2.0 * y**2, y, np.full(400, 0.004)]), 31)


def cloud(nodes: Float64Array, seed: int = 0) -> Float64Array:
    dense = resample(nodes, 1500)
    return dense + np.random.default_rng(seed).normal(0.0, 0.002, dense.shape)


def length_m(nodes: Float64Array) -> float:
    return float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())


@pytest.mark.parametrize("observer", [ours.name for ours in OURS])
def test_a_moving_rod_is_followed(observer: str) -> None:
    tracker = Tracker(length_m=length_m(bow(0.0)), observer=observer)
    followed_nodes = [tracker.update(cloud(bow(0.01 * number), number)) for number in range(4)]
    assert all(nodes.doubt is None and nodes.visible.all() for nodes in followed_nodes)
    assert rmse_m(followed_nodes[-1].positions_world, bow(0.03)) < 0.008


def test_it_answers_as_the_observer_of_a_full_system_does() -> None:
    length = length_m(bow(0.0))
    tracker = Tracker(length_m=length)
    answers = [tracker.update(cloud(bow(0.01 * number), number), stamp_ns=(number + 1) * 10**7) for number in range(3)]
    config, dlo = ObserverConfig(), BelievedDlo(length_m=length)
    strategy = config.strategy.build(dlo)
    for number, (before, after) in enumerate(pairwise(answers), start=1):
        targets = TargetPoints(
            stamp_ns=before.stamp_ns,
            nodes_world=before.positions_world,
            visible=before.visible,
            covariance=before.covariance,
            health=before.health,
        )
        seen = Observation(stamp_ns=after.stamp_ns, points_world=cloud(bow(0.01 * number), number).astype(np.float32))
        expected = followed(strategy, seen, prior_from(targets, chain(31, length)), config).targets
        np.testing.assert_array_equal(after.positions_world, expected.nodes_world)
        assert after.health == expected.health


def test_several_trackers_do_not_disturb_one_another() -> None:
    length = length_m(bow(0.0))
    alone, first, second = (Tracker(length_m=length) for _ in range(3))
    far = bow(0.0) + np.array([0.0, 0.0, 0.5])
    for number in range(3):
        expected = alone.update(cloud(bow(0.01 * number), number))
        got = first.update(cloud(bow(0.01 * number), number))
        second.update(cloud(far, number))
        np.testing.assert_array_equal(got.positions_world, expected.positions_world)


def test_a_cloud_that_shows_nothing_is_no_error_and_the_dlo_is_found_again() -> None:
    tracker = Tracker(length_m=length_m(bow(0.0)))
    before = tracker.update(cloud(bow(0.0)))
    nothing = tracker.update(np.empty((0, 3)))
    assert nothing.doubt is DistrustReason.NO_POINTS
    assert nothing.health == 0.0
    np.testing.assert_array_equal(nothing.positions_world, before.positions_world)
    assert tracker.update(cloud(bow(0.01), 1)).doubt is None


def test_a_first_cloud_without_a_dlo_is_refused_and_the_next_one_can_be_the_first() -> None:
    tracker = Tracker()
    with pytest.raises(InputError, match=r"no_points.*initial_nodes_world"):
        tracker.update(np.random.default_rng(0).normal(size=(3, 3)))
    assert tracker.update(cloud(bow(0.0))).health > 0.5


def test_points_in_the_frame_of_a_camera_give_nodes_in_the_world() -> None:
    T_world_camera = pose([0.5, 0.0, 0.8], [0.0, 1.0, 0.0, 0.0])
    T_camera_world = np.linalg.inv(matrix(T_world_camera))
    rotated = cloud(bow(0.0)) @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    np.testing.assert_allclose(transform(T_world_camera, rotated), cloud(bow(0.0)), atol=1e-12)
    for T in (T_world_camera, matrix(T_world_camera)):
        nodes = Tracker(length_m=length_m(bow(0.0))).update(rotated, T_world_camera=T)
        assert rmse_m(nodes.positions_world, bow(0.0)) < 0.004


def test_a_node_behind_something_nearer_in_the_depth_image_is_hidden() -> None:
    T_world_camera = pose([0.5, 0.0, 0.8], [0.0, 1.0, 0.0, 0.0])
    K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    depth = np.zeros((480, 640))  # unknown
    depth[:240] = 0.3  # a hand above one half: world y > 0
    tracker = Tracker(length_m=length_m(bow(0.0)), initial_nodes_world=bow(0.0), camera_matrix=K)
    in_camera = (cloud(bow(0.0)) - T_world_camera.position_m) * [1.0, -1.0, -1.0]
    nodes = tracker.update(in_camera, T_world_camera=T_world_camera, depth=depth)
    y = bow(0.0)[:, 1]
    assert not nodes.visible[y > 0.02].any()
    assert nodes.visible[y < -0.02].all()


def test_an_observer_of_ones_own_may_keep_a_state_and_is_reset_with_the_tracker() -> None:
    class Counting:
        """Counts its clouds; believes that nothing moves."""

        def __init__(self) -> None:
            self.clouds = 0

        def reset(self) -> None:
            self.clouds = 0

        def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
            self.clouds += 1
            return nothing_seen(seen, prior)

    mine = Counting()
    tracker = Tracker(length_m=length_m(bow(0.0)), observer=mine)
    for number in range(3):
        tracker.update(cloud(bow(0.0), number))
    assert mine.clouds == 2  # the first cloud is ordered without a prior
    tracker.reset()
    assert mine.clouds == 0


def test_settings_of_an_observer_may_be_given() -> None:
    assert Tracker(length_m=LENGTH_M, observer=MapConfig()).topology is not None


def test_compiled_code_is_loaded_before_the_first_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded: list[object] = []
    monkeypatch.setattr(tracking, "load_kernels", loaded.extend)
    Tracker(observer="cpd")
    assert len(loaded) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"length_m": 500.0}, "length_m is 500.0.*metres"),
        ({"radius_m": 4.0}, "radius_m is 4.0.*metres"),
        ({"nodes": 2}, "2 nodes; at least 3"),
        ({"observer": "kalman"}, "kalman.*map, anchored, cpd, spr, som"),
        ({"initial_nodes_world": [[0.0, 0.0]]}, "initial_nodes_world"),
        ({"camera_matrix": [[1.0]]}, "camera_matrix"),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Tracker(**arguments)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": np.zeros((5, 2))}, r"points.*\(5, 2\).*\(N, 3\)"),
        ({"points": np.zeros((5, 3)), "T_world_camera": np.eye(3)}, "T_world_camera"),
        ({"points": np.zeros((5, 3)), "depth": np.zeros(4)}, "depth"),
        ({"points": np.zeros((5, 3)), "depth": np.ones((4, 4))}, "camera_matrix"),
    ],
)
def test_bad_clouds_are_refused_by_name(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Tracker(initial_nodes_world=bow(0.0)).update(**arguments)  # pyright: ignore[reportArgumentType]


def test_without_a_folder_for_compiled_code_no_tracker_begins_to_distrust_its_clouds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(MachineError, match="Set NUMBA_CACHE_DIR"):
        Tracker(length_m=LENGTH_M)
