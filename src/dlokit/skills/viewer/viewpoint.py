"""The viewpoint of a visitor: far enough to show the whole area of goals in a picture of any proportions."""

import math

import numpy as np
import viser

from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.types.arrays import Float64Array

VISITOR_POSITION_M = (1.62, -0.70, 1.04)
"""Viewpoint in a picture that is wider than high, in the world [m]."""
VISITOR_LOOK_AT_M = (0.36, 0.02, 0.20)
VISITOR_FOV_RAD = math.radians(45.0)
"""Angle of view from the top to the bottom of the picture."""
_MARGIN = 0.9
"""Fraction of half the picture's width that the area may reach."""
_FARTHEST = 4.0
_STEP = 0.05
_CHANGED = 0.05
"""The viewpoint is fitted again when the proportions change by more than this fraction, e.g. by turning a tablet."""


def viewpoint(aspect: float) -> Float64Array:
    """The viewpoint (3,) [m] for pictures of this width over height, far enough to show the whole area of goals."""
    look_at = np.array(VISITOR_LOOK_AT_M)
    away = np.array(VISITOR_POSITION_M) - look_at
    for factor in np.arange(1.0, _FARTHEST, _STEP):
        position = look_at + factor * away
        if _reach(position, aspect) <= _MARGIN:
            return position
    return look_at + _FARTHEST * away


def _reach(position: Float64Array, aspect: float) -> float:
    """Extent of the area of goals in the picture, as a fraction of half its width."""
    look_at = np.array(VISITOR_LOOK_AT_M)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    corners = np.array([(x, y, 0.0) for x in TABLE_X_M for y in TABLE_Y_M]) - position
    half_width = math.tan(VISITOR_FOV_RAD / 2.0) * aspect
    return float(np.abs(corners @ right / (corners @ forward)).max() / half_width)


def fit_each_visitor(server: viser.ViserServer) -> None:
    """Set the viewpoint of each visitor for the proportions of their picture, also when these change."""
    server.initial_camera.position = VISITOR_POSITION_M
    server.initial_camera.look_at = VISITOR_LOOK_AT_M
    server.initial_camera.fov = VISITOR_FOV_RAD

    async def came(client: viser.ClientHandle) -> None:
        fitted = 0.0

        async def fit(camera: viser.CameraHandle) -> None:
            nonlocal fitted
            if abs(camera.aspect - fitted) > _CHANGED * fitted:
                fitted = camera.aspect
                # Setting the position also moves the look-at point.
                camera.position = viewpoint(fitted)
                camera.look_at = np.array(VISITOR_LOOK_AT_M)

        client.camera.on_update(fit)
        await fit(client.camera)

    server.on_client_connect(came)
