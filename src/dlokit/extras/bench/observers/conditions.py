"""The difficulty of the clouds of a case, including a ball that occludes the DLO."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from dlokit.geometry import rotation, tangents
from dlokit.geometry.camera import in_camera, rays
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Occlusion

Place = Literal["middle", "tip", "moving"]

RECOVERED_WITHIN = 10
"""Maximum number of frames for a track to recover after the dark."""


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Conditions of a cloud; the default is the base case."""

    hidden: float = 0.3
    """Fraction of the DLO's length that a ball occludes."""
    place: Place = "middle"
    """Position of the ball: in front of the middle, of node 0, or moving back and forth."""
    noise_m: float = 0.002
    """Standard deviation of the depth at `clouds.NOISE_DEPTH_M` [m]."""
    outliers: float = 0.05
    """Fraction of outliers among the points of the cloud."""
    points: int = 1000
    """Number of points of a cloud that shows the whole DLO; it decreases with the visible length."""
    dark_s: float = 0.0
    """Duration for which nothing is visible [s]; see `dark_frames`."""
    camera_error_m: float = 0.0
    """Position error of the believed camera pose [m]."""
    camera_error_rad: float = 0.0
    """Rotation error of the believed camera pose [rad]."""


def dark_frames(conditions: Conditions, frames: int, rate_hz: float) -> range:
    """The dark frames of a sequence; one third of the other frames precedes, two thirds follow."""
    dark = round(conditions.dark_s * rate_hz)
    first = max(1, (frames - dark) // 3)
    return range(first, first + dark)


def long_enough(conditions: Conditions, frames: int, rate_hz: float) -> bool:
    """Whether frames precede the dark, and enough frames follow it for a track to recover."""
    dark = dark_frames(conditions, frames, rate_hz)
    return len(dark) == 0 or (dark.start >= 3 and frames - dark.stop > RECOVERED_WITHIN)


Span = tuple[int, int]

BALL_AT = 0.7
"""Position of the ball between camera (0) and DLO (1): near the camera a small ball hides much."""
SCALE = 8
"""Pixels per cell of the depth image that shows the ball to the observer."""
_WIDE_RAD = 1.5  # a ray this far aside leaves the picture


@dataclass(frozen=True, kw_only=True)
class Ball:
    """An occluding object of known geometry, like the robot."""

    centre_world: Float64Array  # (3,) [m]
    radius_m: float


def hides(ball: Ball, eye_world: Float64Array, positions_world: Float64Array) -> BoolArray:
    """Whether the ball intersects the view ray from the camera (3,) to each position (K, 3), (K,)."""
    return passing_m(ball.centre_world, eye_world, positions_world) < ball.radius_m


def passing_m(place_world: Float64Array, eye_world: Float64Array, positions_world: Float64Array) -> Float64Array:
    """Distance (K,) [m] of the view ray from the eye (3,) to each position (K, 3) from a place (3,) [m]."""
    rays = positions_world - eye_world
    to_place = place_world - eye_world
    nearest = np.clip(rays @ to_place / np.maximum(np.sum(rays**2, axis=1), 1e-12), 0.0, 1.0)
    return np.linalg.norm(nearest[:, None] * rays - to_place, axis=1)


def ball_hiding(fraction: float, aim_world: Float64Array, line_world: Float64Array, eye_world: Float64Array) -> Ball:
    """The ball on the view ray to a place (3,) [m] that occludes a fraction of a line's points (K, 3) [m].

    It never reaches the camera; if a larger fraction needs a larger ball, the ball hides less.
    """
    centre = eye_world + BALL_AT * (aim_world - eye_world)
    passing = np.sort(passing_m(centre, eye_world, line_world))
    count = min(max(round(fraction * len(line_world)), 1), len(line_world))
    radius_m = float(passing[count - 1 : count + 1].mean())  # between the last ray it cuts and the next
    if count == len(line_world):
        radius_m *= 1.0 + 1e-9
    return Ball(centre_world=centre, radius_m=min(radius_m, 0.99 * float(np.linalg.norm(centre - eye_world))))


def depth_image(ball: Ball, camera: CameraCalibration) -> Occlusion:
    """The ball's depth as the camera sees it, at the middle of each cell."""
    rows, columns = -(-camera.height_px // SCALE), -(-camera.width_px // SCALE)
    depth = np.full((rows, columns), np.inf, dtype=np.float32)
    c = in_camera(ball.centre_world, camera)
    left, right = _cells(c[0], c[2], ball.radius_m, camera.fx_px, camera.cx_px, columns)
    top, bottom = _cells(c[1], c[2], ball.radius_m, camera.fy_px, camera.cy_px, rows)
    u, v = np.meshgrid((np.arange(left, right) + 0.5) * SCALE, (np.arange(top, bottom) + 0.5) * SCALE)
    d = rays(np.column_stack([u.ravel(), v.ravel()]), camera).reshape(*u.shape, 3)
    # |z d - c|² = r², solved for the nearer depth z.
    a, b = np.sum(d**2, axis=-1), d @ c
    squared = b**2 - a * (c @ c - ball.radius_m**2)
    depth[top:bottom, left:right] = np.where(squared >= 0.0, (b - np.sqrt(np.maximum(squared, 0.0))) / a, np.inf)
    return Occlusion(depth_m=depth, scale=SCALE)


def _cells(aside_m: float, ahead_m: float, radius_m: float, focal_px: float, centre_px: float, count: int) -> Span:
    """The range of cells along one side of the picture that can show the ball."""
    middle = np.arctan2(aside_m, ahead_m)
    half = np.arcsin(min(1.0, radius_m / max(float(np.hypot(aside_m, ahead_m)), 1e-12)))
    if abs(middle) + half > _WIDE_RAD:
        return 0, count
    at = (np.tan(np.array([middle - half, middle + half])) * focal_px + centre_px) / SCALE
    return int(np.clip(np.floor(at[0]), 0, count)), int(np.clip(np.ceil(at[1]), 0, count))


def behind_itself(line_world: Float64Array, radius_m: float, camera: CameraCalibration) -> BoolArray:
    """Which points (K,) of a rod's centre line (K, 3) [m], spaced closer than its radius, another part of it hides.

    A point is hidden when the ray to its side that faces the camera passes through the rod elsewhere. A part that
    points straight at the camera thus does not hide itself: its side is visible.
    """
    line = in_camera(line_world, camera)
    along = tangents(line)
    facing = -line + np.sum(line * along, axis=1, keepdims=True) * along
    surface = line + radius_m * facing / np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-12)
    seen, middle = surface[:, :2] / surface[:, 2:], line[:, :2] / line[:, 2:]
    pairs = KDTree(np.concatenate([seen, middle])).query_pairs(
        radius_m / float(line[:, 2].min()), output_type="ndarray"
    )
    back, front = pairs.min(axis=1), pairs.max(axis=1) - len(line)
    of_both = (back < len(line)) & (front >= 0)
    back, front = back[of_both], front[of_both]
    # Less than the radius: the line consists of points, and their own side is a radius away.
    through = np.linalg.norm(seen[back] - middle[front], axis=1) * line[front, 2] < 0.9 * radius_m
    nearer = surface[back, 2] - line[front, 2] > 0.25 * radius_m
    hidden = np.zeros(len(line), dtype=np.bool_)
    hidden[back[through & nearer]] = True
    return hidden


def depths_m(positions_world: Float64Array, camera: CameraCalibration) -> Float64Array:
    """Depth (K,) [m] of positions (K, 3) [m] along the camera's z axis."""
    T = camera.T_world_camera
    return (positions_world - T.position_m) @ rotation(T)[:, 2]
