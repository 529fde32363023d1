"""`dlokit.Tracker`: clouds in, nodes out, alike to the observer of a full system."""

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from counting_observer import CountingConfig

from dlokit.app.library import tracker as tracking
from dlokit.app.library.tracker import Nodes, Tracker, filtered, points_from_depth
from dlokit.errors import InputError, MachineError
from dlokit.geometry import resample, rmse_m
from dlokit.geometry.poses import matrix, pose, transform
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import nothing_seen, prior_from
from dlokit.skills.observer.config import OURS, ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.skills.observer.map.observer import MapConfig
from dlokit.skills.perception.config import CloudConfig
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
    assert all(nodes.distrust is None and nodes.visible.all() for nodes in followed_nodes)
    assert rmse_m(followed_nodes[-1].positions_world, bow(0.03)) < 0.008


@pytest.mark.parametrize(
    ("observer", "last"),
    [("cpd", DistrustReason.SHORTENED), ("spr", DistrustReason.SHORTENED), ("map", None), ("anchored", None)],
)
def test_a_rod_that_is_drawn_onto_its_visible_part_is_not_trusted(observer: str, last: DistrustReason | None) -> None:
    tracker = Tracker(length_m=length_m(bow(0.0)), observer=observer)
    tracker.update(cloud(bow(0.0)))
    end_hidden = [points[points[:, 1] < 0.11] for points in (cloud(bow(0.0), seed) for seed in range(1, 10))]
    nodes = [tracker.update(points) for points in end_hidden]
    assert all(one.health > 0.75 for one in nodes)
    assert nodes[-1].distrust is last


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
        points = filtered(cloud(bow(0.01 * number), number), CloudConfig.voxel_m).astype(np.float32)
        seen = Observation(stamp_ns=after.stamp_ns, points_world=points)
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
    assert nothing.distrust is DistrustReason.NO_POINTS
    assert nothing.health == 0.0
    np.testing.assert_array_equal(nothing.positions_world, before.positions_world)
    assert tracker.update(cloud(bow(0.01), 1)).distrust is None


def test_a_first_cloud_without_a_dlo_is_refused_and_the_next_one_can_be_the_first() -> None:
    tracker = Tracker()
    with pytest.raises(InputError, match=r"3 points.*no points with 4 others near them.*voxel_m=0"):
        tracker.update(np.random.default_rng(0).normal(size=(3, 3)))
    with pytest.raises(InputError, match=r"no_points.*initial_nodes_world"):
        tracker.update(np.empty((0, 3)))
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


def test_after_a_reset_the_length_is_that_of_the_next_first_cloud() -> None:
    def tracked_length_m(tracker: Tracker) -> float:
        assert tracker.topology is not None
        return float(tracker.topology.rest_lengths_m.sum())

    tracker, half = Tracker(), resample(bow(0.0)[:16], 31)
    tracker.update(cloud(bow(0.0)))
    tracker.reset()
    assert tracker.topology is None
    tracker.update(cloud(half))
    assert tracked_length_m(tracker) == pytest.approx(length_m(half), abs=0.02)  # the cloud's noise is 2 mm


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
        ({"voxel_m": -0.001}, "voxel_m is -0.001.*metres"),
        ({"observer": "kalman"}, "kalman.*map, anchored, cpd, spr, som"),
        ({"initial_nodes_world": [[0.0, 0.0]]}, "initial_nodes_world"),
        ({"initial_nodes_world": np.stack([bow(0.0), bow(0.1)])}, r"initial_nodes_world.*\(2, 31, 3\).*one by one"),
        ({"initial_nodes_world": bow(0.0) * 1000.0}, "initial_nodes_world.*metres"),
        ({"length_m": "0.5"}, "length_m is '0.5'"),
        ({"length_m": np.nan}, "length_m is nan"),
        ({"nodes": 31.0}, "nodes is 31.0; give a whole number of nodes"),
        ({"camera_matrix": [[1.0]]}, "camera_matrix"),
        ({"camera_matrix": [[500.0, 2.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]}, "without skew"),
        ({"camera_matrix": [[500.0, 0.0, 0.0], [0.0, 500.0, 0.0], [320.0, 240.0, 1.0]]}, "without skew"),
        ({"camera_matrix": [[0.8, 0.0, 0.5], [0.0, 0.8, 0.5], [0.0, 0.0, 0.002]]}, "without skew"),
        ({"camera_matrix": np.zeros((3, 3))}, "camera_matrix.*above 0"),
        ({"camera_matrix": np.diag([0.0, 500.0, 1.0])}, "camera_matrix.*above 0"),
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
        ({"points": np.zeros((5, 3)), "T_world_camera": np.diag([1.0, -1.0, 1.0, 1.0])}, "T_world_camera.*mirrors"),
        ({"points": np.zeros((5, 3)), "T_world_camera": pose([0.0, 0.0, 900.0])}, "T_world_camera.*metres"),
        ({"points": np.zeros((5, 3)), "depth": np.ones((4, 4))}, "camera_matrix"),
        ({"points": bow(0.0) * 1000.0}, "points.*metres"),
        ({"points": np.zeros((5, 3)), "stamp_ns": 1764300000.5}, "stamp_ns is 1764300000.5.*1e9"),
    ],
)
def test_bad_clouds_are_refused_by_name(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Tracker(initial_nodes_world=bow(0.0), voxel_m=0).update(**arguments)  # pyright: ignore[reportArgumentType]


class Keeping:
    """An observer that keeps the nodes, and the cloud that it was given."""

    points = np.zeros((0, 3), dtype=np.float32)

    def estimate(self, seen: Observation, prior: DloState) -> Float64Array:
        self.points = seen.points_world
        return prior.nodes_world


def test_pixels_without_depth_and_masked_points_are_omitted() -> None:
    mine = Keeping()
    tracker = Tracker(observer=mine, initial_nodes_world=bow(0.0), voxel_m=0)
    T_world_camera = pose([0.5, 0.0, 0.8], [0.0, 1.0, 0.0, 0.0])
    in_camera = (bow(0.0) - T_world_camera.position_m) * [1.0, -1.0, -1.0]
    with_holes = np.ma.masked_array(np.vstack([in_camera, np.zeros((40, 3)), [[0.0, 0.0, 0.79]] * 5]), mask=False)
    with_holes[-5:] = np.ma.masked
    tracker.update(with_holes, T_world_camera=T_world_camera)
    np.testing.assert_allclose(mine.points, bow(0.0), atol=1e-6)


def test_a_first_cloud_that_is_no_line_is_described() -> None:
    with pytest.raises(InputError, match=r"1000 points, 0 x 0 x 0 m large, 0 mm apart"):
        Tracker(voxel_m=0).update(np.tile([[0.5, 0.1, 0.004]], (1000, 1)))


def reasons(stamps_ns: list[int]) -> list[DistrustReason | None]:
    tracker = Tracker(observer=Keeping(), initial_nodes_world=bow(0.0), voxel_m=0)
    found = [tracker.update(bow(0.0), stamp_ns=stamp_ns) for stamp_ns in stamps_ns]
    assert [nodes.stamp_ns for nodes in found] == stamps_ns
    return [nodes.distrust for nodes in found]


def test_a_clock_that_was_set_back_is_one_reason_for_distrust() -> None:
    jumped = DistrustReason.CLOCK_JUMPED
    recording = [10**9 + number * 33_000_000 for number in range(3)]
    assert reasons(recording * 3) == [None, None, None, jumped, None, None, jumped, None, None]
    assert reasons([3600 * 10**9, *recording]) == [None, jumped, None, None]
    assert reasons([10, 10]) == [None, DistrustReason.OLD_STAMP]


def test_nodes_say_in_a_line_how_they_were_seen_and_are_drawn(tmp_path: Path) -> None:
    tracker = Tracker(observer=Keeping(), initial_nodes_world=bow(0.0), voxel_m=0)
    nodes = tracker.update(bow(0.0), stamp_ns=7)
    assert repr(nodes) == "<Nodes at 7 ns: 31 of 31 visible, health 1.00>"
    lost = tracker.update(np.empty((0, 3)), stamp_ns=8)
    assert repr(lost) == "<Nodes at 8 ns: 0 of 31 visible, health 0.00, not trusted: no_points>"
    drawn = lost.plot(tmp_path / "nodes.png")
    assert drawn.axes[0].get_legend() is not None
    assert (tmp_path / "nodes.png").read_bytes().startswith(b"\x89PNG")


K = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])


def test_depth_mask_and_camera_matrix_give_the_points() -> None:
    depth = np.zeros((480, 640))
    depth[100, 320], depth[240, 420], depth[10, 10] = 0.5, 1.0, 0.7
    mask = np.zeros((480, 640), dtype=np.uint8)
    mask[100, 320] = mask[240, 420] = mask[300, 300] = 255  # without depth at the last, without mask at (10, 10)
    for matrix_px in (K, K.ravel().tolist()):
        points = points_from_depth(depth, mask, matrix_px)
        np.testing.assert_allclose(points, [[0.0, -0.14, 0.5], [0.2, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("depth", "mask", "message"),
    [
        (np.ones((4, 4)), np.ones((4, 5)), r"mask has the shape \(4, 5\).*\(4, 4\)"),
        (np.ones((4, 4)), np.ones((4, 4, 3)), "mask"),
        (np.ones((4, 4)) * 800.0, np.ones((4, 4)), "depth.*millimetres"),
        (np.ones(4), np.ones(4), "depth has the shape"),
    ],
)
def test_a_depth_image_that_cannot_be_used_is_named(depth: np.ndarray, mask: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        points_from_depth(depth, mask, K)


def test_the_radius_reaches_the_first_order_of_the_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    radii: list[tuple[float, bool]] = []

    def ordered(*args: object, radius_m: float, given: bool) -> TargetPoints:
        radii.append((radius_m, given))
        return TargetPoints(stamp_ns=1, nodes_world=bow(0.0), visible=np.ones(31, dtype=np.bool_))

    monkeypatch.setattr(tracking, "initial_targets", ordered)
    for tracker in (Tracker(radius_m=0.02), Tracker(radius_m=0.004), Tracker()):
        assert isinstance(tracker.update(cloud(bow(0.0))), Nodes)
    assert radii == [(0.02, True), (0.004, True), (0.004, False)]


def test_without_a_folder_for_compiled_code_no_tracker_begins_to_distrust_its_clouds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(MachineError, match="Set NUMBA_CACHE_DIR"):
        Tracker(length_m=LENGTH_M)


def test_an_observer_s_memory_comes_back_with_each_cloud_until_the_tracker_is_reset() -> None:
    counts: list[int] = []
    tracker = Tracker(length_m=length_m(bow(0.0)), observer=CountingConfig(given=counts))
    counts.clear()  # the call that loads compiled code
    for number in range(4):
        tracker.update(cloud(bow(0.0), number))
    tracker.reset()
    assert counts[:3] == [0, 1, 2]
    counts.clear()
    for number in range(2):
        tracker.update(cloud(bow(0.0), number))
    assert counts == [0]
