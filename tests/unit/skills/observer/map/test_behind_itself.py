"""A rod that crosses itself, seen from above: nodes hidden by its upper part."""

import numpy as np
import pytest

from dlokit.geometry import downward, inverse, transform
from dlokit.skills.observer.map.view import behind_itself
from dlokit.types.image import CameraCalibration

RADIUS_M = 0.004
CAMERA = CameraCalibration(
    width_px=640,
    height_px=480,
    fx_px=600.0,
    fy_px=600.0,
    cx_px=319.5,
    cy_px=239.5,
    T_world_camera=downward([0.5, 0.0, 0.8], 0.3),
)


def crossed(over_m: float) -> np.ndarray:
    """25 nodes along y under 25 nodes along x that pass `over_m` above them, joined far outside."""
    t = np.linspace(-0.12, 0.12, 25)
    lower = np.column_stack([np.full(25, 0.5), t, np.full(25, RADIUS_M)])
    upper = np.column_stack([0.5 - t, np.zeros(25), np.full(25, RADIUS_M + over_m)])
    return np.vstack([lower, upper])


def by_definition(nodes: np.ndarray) -> list[bool]:
    """Whether the ray from the camera to a node passes another piece's axis within a radius, well in front."""
    p = transform(inverse(CAMERA.T_world_camera), nodes)
    hidden = []
    for i, node in enumerate(p):
        found = False
        for j in range(len(p) - 1):
            if j in (i - 1, i):
                continue
            piece = p[j] + np.linspace(0.0, 1.0, 200)[:, None] * (p[j + 1] - p[j])
            on_ray = node / node[2] * piece[:, 2:]
            near = np.linalg.norm(piece - on_ray, axis=1) <= RADIUS_M
            found |= bool(np.any(near & (node[2] - piece[:, 2] > 1.5 * RADIUS_M)))
        hidden.append(found)
    return hidden


def test_the_lower_part_is_hidden_where_the_upper_one_crosses_it_and_nowhere_else() -> None:
    hidden = behind_itself(crossed(2 * RADIUS_M), RADIUS_M, CAMERA)
    assert np.flatnonzero(hidden).tolist() == [12]


def test_adjacent_parts_do_not_hide_each_other() -> None:
    assert not behind_itself(crossed(0.0), RADIUS_M, CAMERA).any()


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_result_agrees_with_ray_casting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0.3, 0.4, 50))  # a rising spiral
    steps = 0.01 * np.column_stack([np.cos(heading), np.sin(heading), np.full(50, 0.05)])
    nodes = np.array([0.5, 0.0, 0.05]) + np.cumsum(steps, axis=0)
    hidden = behind_itself(nodes, RADIUS_M, CAMERA)
    assert hidden.any()
    assert hidden.tolist() == by_definition(nodes)


def test_nodes_behind_the_camera_hide_nothing_and_are_not_hidden() -> None:
    nodes = crossed(2 * RADIUS_M)
    nodes[25:, 2] = 0.9
    assert not behind_itself(nodes, RADIUS_M, CAMERA).any()


def test_without_a_camera_nothing_is_known_to_be_hidden() -> None:
    assert not behind_itself(crossed(2 * RADIUS_M), RADIUS_M, None).any()
