"""How thick the DLO is: the area of its mask over the length that the camera sees of it."""

import numpy as np

from dlokit.skills.perception.pipeline import Look
from dlokit.types.arrays import Float64Array


def radius_m(look: Look, nodes_world: Float64Array) -> float | None:
    """Radius [m] of a DLO whose centre line is `nodes_world` (M, 3) [m], tip to tip; None where nothing is seen.

    A thin round rod that runs at an angle a to the line of sight shows 2 r sin(a) of area for each metre; a pixel
    at the distance Z shows (Z / f)². The mask must show the whole DLO.
    """
    camera = look.observation.calibration
    if camera is None or not look.mask.any():
        return None
    edges = np.diff(nodes_world, axis=0)
    view = 0.5 * (nodes_world[1:] + nodes_world[:-1]) - camera.T_world_camera.position_m
    distance_m = np.linalg.norm(view, axis=1)
    across_m = np.linalg.norm(np.cross(edges, view), axis=1) / distance_m
    focal_px = float(np.sqrt(camera.fx_px * camera.fy_px))
    # The width in pixels is taken to be the same everywhere: the distance differs by a few percent along the DLO.
    width_px = float(look.mask.sum()) / float((across_m * focal_px / distance_m).sum())
    return 0.5 * width_px * float(np.average(distance_m, weights=across_m)) / focal_px
