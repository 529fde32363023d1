"""The viewpoint of people, and scenes that are shown again."""

import numpy as np
import pytest

from dlokit.description.arm.mounts import ArmMount
from dlokit.description.dlo import WIRE_A
from dlokit.description.installation import PAPERS_CELL
from dlokit.functional.cell.arm import ArmPosture
from dlokit.functional.cell.config import CellConfig, ElastoplasticChain
from dlokit.functional.cell.rendering import viewpoint_camera
from dlokit.functional.cell.world import Cell
from dlokit.geometry.camera import project
from dlokit.types.robot import FIRST_ROBOT

CAMERA = viewpoint_camera(160, 106, PAPERS_CELL, ArmMount())


def test_the_usable_table_is_in_the_picture_and_upright() -> None:
    corners = project([[x, y, 0.0] for x in (0.3, 0.75) for y in (-0.35, 0.35)], CAMERA)
    assert np.all(corners.depth_m > 0.5)
    assert np.all((corners.pixels > 0.0) & (corners.pixels < [160.0, 106.0]))
    low, high = project([[0.45, 0.0, 0.0], [0.45, 0.0, 0.2]], CAMERA).pixels
    assert abs(low[0] - high[0]) < 1e-6
    assert high[1] < low[1]


@pytest.mark.parametrize(
    "config",
    [CellConfig(), CellConfig(dlo=WIRE_A, physics=ElastoplasticChain(), randomised=("color",))],
    ids=["rod", "chain"],
)
def test_a_moment_that_is_shown_again_looks_as_it_did(config: CellConfig) -> None:
    config = CellConfig(dlo=config.dlo, physics=config.physics, randomised=config.randomised, image_noise_sigma=0.0)
    seen, shown = (Cell(config, seed=1, viewpoint=CAMERA) for _ in range(2))
    half_m = config.dlo.length_m / 2
    seen.place_dlo([[0.4, -half_m], [0.4, half_m]], settle=False)
    seen.arm.fingers.start_grip(0.02, 20.0)
    seen.step(0.3)
    state, nodes = seen.arm_state(), seen.true_nodes_world()

    shown.show(nodes, {FIRST_ROBOT: ArmPosture(q_rad=state.q_rad, finger_width_m=state.finger_width_m)})

    again = shown.arm_state()
    np.testing.assert_allclose(shown.true_nodes_world(), nodes, atol=1e-4)  # links of a chain keep their length
    np.testing.assert_array_equal(again.q_rad, state.q_rad)
    assert again.finger_width_m == pytest.approx(state.finger_width_m, abs=1e-12)
    assert again.finger_width_m < 0.07
    assert shown.time_ns == 0
    difference = np.abs(seen.view().astype(int) - shown.view())
    assert np.mean(difference) < 0.05  # of 255: edges of links that are turned about their axis
    seen.close()
    shown.close()
