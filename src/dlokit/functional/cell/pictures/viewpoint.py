"""A person's view of the cell: one more camera, without noise and without a lens, for videos of a run."""

from typing import Any

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.installation import Installation
from dlokit.functional.cell.pictures.rendering import Rig
from dlokit.geometry.camera import centred_camera
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration

VIEWPOINT = "viewpoint"
ABOVE_TABLE_M = 0.15
"""The camera looks at a point this high above the middle of the table [m]: the arm is in the picture as well."""
DISTANCE_M = 1.65
"""From the camera to that point [m]: the picture shows the usable table and an arm that stands at its edge."""
ELEVATION_DEG = 38.0
TURN_DEG = 45.0
"""Of the camera about the vertical, from the line that continues the arm's reach: its fingers hide less of the DLO."""
FOCAL_PER_WIDTH = 1.1
"""Focal length over the width of the picture: 49° across."""


def viewpoint_camera(width_px: int, height_px: int, installation: Installation, arm: ArmMount) -> CameraCalibration:
    """The camera of a person who stands at the table opposite an arm, a little to the side."""
    centre = np.array([*installation.table.centre_m, ABOVE_TABLE_M])
    reach = centre[:2] - np.array(arm.place_m)
    bearing_rad = float(np.arctan2(reach[1], reach[0])) + np.radians(TURN_DEG)
    elevation_rad = np.radians(ELEVATION_DEG)
    away = np.array([np.cos(bearing_rad), np.sin(bearing_rad), np.tan(elevation_rad)]) * np.cos(elevation_rad)
    T = geometry.homogeneous(_looking_along(-away), centre + DISTANCE_M * away)
    camera = centred_camera(width_px, height_px, FOCAL_PER_WIDTH * width_px, geometry.pose_from_matrix(T))
    return msgspec.structs.replace(camera, serial=VIEWPOINT)


def _looking_along(forward: Float64Array) -> Float64Array:
    """The rotation (3, 3) of a camera (x right, y down, z forward) that looks along a unit vector and is upright."""
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack((right, np.cross(forward, right), forward))


class ViewpointRig(Rig):
    """Renders the pictures of the viewpoint's camera."""

    def __init__(self, calibration: CameraCalibration, *, shadows: bool) -> None:
        self.calibration = calibration
        self._shadows = shadows

    def capture(self, model: Any, data: Any) -> UInt8Array:
        """A picture (height, width, 3) of the present moment; poses in `data` must be up to date."""
        size = self.calibration.width_px, self.calibration.height_px
        return self._renderer_for(model, *size, shadows=self._shadows).render(data, VIEWPOINT)
