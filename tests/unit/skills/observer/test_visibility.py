"""Nodes that an observation could see, and the motion of hidden nodes."""

import msgspec
import numpy as np
import pytest
from synthetic_clouds import cloud, hose, shape, state

from dlokit.geometry import downward, resample, rmse_m, transform
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import Anchored, chain, fill_hidden
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS
from dlokit.skills.observer.visibility import LEAST_SUPPORT, shaded, supported
from dlokit.types.dlo import DloState
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Observation, Occlusion

CAMERA = CameraCalibration(
    width_px=640,
    height_px=480,
    fx_px=600.0,
    fy_px=600.0,
    cx_px=319.5,
    cy_px=239.5,
    T_world_camera=downward([0.5, 0.0, 1.0], 0.0),
)


def look(occlusion: Occlusion | None = None) -> Observation:
    return Observation(
        stamp_ns=1, points_world=np.zeros((0, 3), dtype=np.float32), calibration=CAMERA, occlusion=occlusion
    )


def robot_at(pixel: tuple[int, int], depth_m: float) -> Occlusion:
    """A robot that covers one cell of 8 px."""
    depth = np.full((60, 80), np.inf, dtype=np.float32)
    depth[pixel[1] // 8, pixel[0] // 8] = depth_m
    return Occlusion(depth_m=depth, scale=8)


def at_pixel(u: float, v: float, depth_m: float) -> np.ndarray:
    p_camera = np.array([[(u - CAMERA.cx_px) * depth_m / 600.0, (v - CAMERA.cy_px) * depth_m / 600.0, depth_m]])
    return transform(CAMERA.T_world_camera, p_camera)


@pytest.mark.parametrize("config", [of() for of in OURS], ids=lambda config: config.name)
def test_a_thick_dlo_is_followed_as_surely_as_a_thin_one_by_its_radius(config: ObserverStrategyConfig) -> None:
    line, seen = hose(0.02)
    truth = resample(line, 31)
    prior = DloState(stamp_ns=0, nodes_world=truth + np.array([0.01, 0.0, 0.0]), topology=chain(31, 1.0))
    found = config.build(BelievedDlo(radius_m=0.02, length_m=1.0)).estimate(seen, prior)
    assert rmse_m(found.nodes_world[:, :2], truth[:, :2]) < 0.025  # less than an edge: a map pulls in its tips
    assert found.visible.all()
    assert found.health > 0.9


def test_nodes_outside_the_image_or_behind_the_camera_are_hidden() -> None:
    inside, left, border = at_pixel(320, 240, 1.0), at_pixel(-5, 240, 1.0), at_pixel(320, 478.5, 1.0)
    behind = at_pixel(320, 240, -0.5)
    flags = shaded(np.vstack([inside, left, border, behind]), look())
    assert flags.tolist() == [False, True, True, True]


def test_nodes_behind_the_robot_are_hidden_and_nodes_in_front_are_not() -> None:
    occlusion = robot_at((320, 240), 0.8)
    far, near = at_pixel(320, 240, 1.0), at_pixel(320, 240, 0.7)
    touching, beside = at_pixel(320, 240, 0.805), at_pixel(400, 240, 1.0)
    flags = shaded(np.vstack([far, near, touching, beside]), look(occlusion))
    assert flags.tolist() == [True, False, False, False]


def test_without_a_camera_no_node_is_known_to_be_hidden() -> None:
    seen = msgspec.structs.replace(look(), calibration=None)
    assert not shaded(np.array([[9.0, 9.0, 9.0]]), seen).any()


def test_a_node_needs_points_around_it() -> None:
    points = np.array([[0.0, 0.0, 0.0]] * LEAST_SUPPORT + [[1.0, 0.0, 0.0]])
    assert supported(np.array([[0.005, 0.0, 0.0], [1.0, 0.0, 0.0]]), points).tolist() == [True, False]
    assert not supported(points, np.zeros((0, 3))).any()


def test_the_image_border_does_not_count_as_the_tip() -> None:
    rod = shape("I") + np.array([0.0, 0.28, 0.0])  # its first 0.13 m lie beyond y = 0.4, the border of the picture
    seen = cloud(rod)
    inside = seen.points_world[:, 1] < 0.385
    seen = msgspec.structs.replace(seen, points_world=seen.points_world[inside], calibration=CAMERA)
    # The registration pulls the nodes into the visible part; only the image border shows that the tip is beyond.
    result = Anchored().estimate(seen, state(rod + np.array([0.01, -0.01, 0.0])))
    assert np.sqrt(np.mean(np.sum((result.nodes_world - rod) ** 2, axis=1))) < 0.010  # the bound for hidden parts
    assert not result.visible[:5].any()
    assert result.visible[12:].all()


def test_hidden_nodes_move_as_their_neighbours_moved() -> None:
    prior = shape("S")
    nodes = prior + np.array([0.03, -0.01, 0.0])
    known = np.ones(len(prior), dtype=np.bool_)
    known[[0, 1, 12, 13, 14, 30]] = False
    spoiled = nodes.copy()
    spoiled[~known] = 9.0
    np.testing.assert_allclose(fill_hidden(spoiled, known, prior), nodes, atol=1e-9)  # a shift is exact


def test_a_hidden_end_turns_with_the_rod() -> None:
    prior = shape("I")
    turn = 0.3
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    nodes = prior @ R.T
    known = np.arange(len(prior)) < 24
    np.testing.assert_allclose(fill_hidden(nodes, known, prior), nodes, atol=1e-9)  # a turn is exact


def test_without_information_the_prior_stays() -> None:
    prior = shape("S")
    np.testing.assert_array_equal(fill_hidden(prior + 1.0, np.zeros(len(prior), dtype=np.bool_), prior), prior)
