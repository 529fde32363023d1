"""The cloud of all that a camera of the cell sees."""

from typing import Any

import numpy as np
import pytest

from dlokit.description.shapes import builtin_shape
from dlokit.extras.calibration.plane_fit import fit_plane
from dlokit.extras.calibration.scene_cloud import scene_cloud
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell


@pytest.mark.parametrize(
    ("config", "depth"),
    [
        pytest.param({}, False, id="stereo"),
        pytest.param({"width_px": 1280, "height_px": 1120}, False, id="large pictures"),
        pytest.param({"separate_cameras": True}, False, id="separate cameras"),
        pytest.param({}, True, id="depth"),
    ],
)
def test_the_table_of_the_cell_is_a_plane_at_its_height_in_the_cloud(config: dict[str, Any], depth: bool):
    cell = Cell(CellConfig(camera_error_m=0.0, camera_error_deg=0.0, **config), seed=0)
    cell.place_dlo(builtin_shape("I", 0.5, 100), settle=False)
    cloud = scene_cloud(cell.capture_depth() if depth else cell.capture())
    cell.close()
    points = cloud.points_world
    assert 5000 < len(points) <= 40_000
    assert cloud.colours.shape == points.shape
    near = (np.abs(points[:, 0] - 0.5) < 0.2) & (np.abs(points[:, 1]) < 0.3) & (np.abs(points[:, 2]) < 0.1)
    fit = fit_plane(points[near])
    assert abs(fit.frame.position_m[2]) < 3e-3
    assert np.degrees(fit.tilt_rad) < 0.5
