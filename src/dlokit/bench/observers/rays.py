"""What hides the DLO: a ball that stands in the way of the camera's view rays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dlokit.geometry import inverse, rotation, transform
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Occlusion

Flags = NDArray[np.bool_]

STANDS_AT = 0.7
"""The ball's middle lies at this share of the way from the camera to the DLO, so that a small one hides much."""
SCALE = 8
"""Pixels a cell of the depth image in which the observer gets to know the ball."""


@dataclass(frozen=True, kw_only=True)
class Ball:
    """Something in the way, of known geometry like the robot."""

    centre_world: Float64Array  # (3,) [m]
    radius_m: float


def hides(ball: Ball, eye_world: Float64Array, positions_world: Float64Array) -> Flags:
    """Whether the ball cuts the view ray from the camera's eye (3,) to each position (K, 3), (K,)."""
    rays = positions_world - eye_world
    to_ball = ball.centre_world - eye_world
    nearest = np.clip(rays @ to_ball / np.maximum(np.sum(rays**2, axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(nearest[:, None] * rays - to_ball, axis=1) < ball.radius_m)


def ball_hiding(share: float, aim_world: Float64Array, line_world: Float64Array, eye_world: Float64Array) -> Ball:
    """The ball on the view ray to a place (3,) [m] that hides a share of a line's points (K, 3) [m]."""
    centre = eye_world + STANDS_AT * (aim_world - eye_world)
    small_m, large_m = 0.0, float(np.linalg.norm(aim_world - eye_world)) * STANDS_AT
    for _ in range(30):
        radius_m = (small_m + large_m) / 2.0
        hidden = np.mean(hides(Ball(centre_world=centre, radius_m=radius_m), eye_world, line_world))
        small_m, large_m = (radius_m, large_m) if hidden < share else (small_m, radius_m)
    return Ball(centre_world=centre, radius_m=large_m)


def depth_image(ball: Ball, camera: CameraCalibration) -> Occlusion:
    """The ball's depth as the camera sees it, at the middle of each cell."""
    rows, columns = -(-camera.height_px // SCALE), -(-camera.width_px // SCALE)
    u, v = np.meshgrid((np.arange(columns) + 0.5) * SCALE, (np.arange(rows) + 0.5) * SCALE)
    d = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones_like(u)], axis=-1)
    c = transform(inverse(camera.T_world_camera), ball.centre_world[None, :])[0]
    # |z d - c|² = r², solved for the nearer depth z.
    a, b = np.sum(d**2, axis=-1), d @ c
    inside = b**2 - a * (c @ c - ball.radius_m**2)
    depth = np.where(inside >= 0.0, (b - np.sqrt(np.maximum(inside, 0.0))) / a, np.inf)
    return Occlusion(depth_m=depth.astype(np.float32), scale=SCALE)


def depths_m(positions_world: Float64Array, camera: CameraCalibration) -> Float64Array:
    """Depth (K,) [m] of positions (K, 3) [m] along the camera's z axis."""
    T = camera.T_world_camera
    return (positions_world - T.position_m) @ rotation(T)[:, 2]
