"""What fixtures show and hide in a picture: rays from the camera into posts and boxes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from dlokit.description.scene import Fixture, Post
from dlokit.geometry import rotation
from dlokit.geometry.camera import project, rays
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Occlusion

MARGIN_M = 0.002
"""Fixtures are this much larger for the filter on every side [m]: the error of their poses by a ruler."""
_SCALE = 2
"""Camera pixels per cell of an occlusion map with fixtures: a post of 10 mm is 6 px wide. A coarse map would hide the
rope beside it as well."""
_PARALLEL = 1e-12  # a direction with a smaller component is taken for this much off the plane


def behind_fixtures(
    points_world: NDArray[np.floating], fixtures: Sequence[Fixture], camera: CameraCalibration
) -> BoolArray:
    """Whether the line of sight to each point (N, 3) [m] enters a fixture before it, (N,).

    Such a point is on the fixture's surface, or its depth is wrong. What is nearer to the camera, or beside the
    fixture, is not behind it.
    """
    eye = camera.T_world_camera.position_m
    behind = np.zeros(len(points_world), dtype=np.bool_)
    for fixture in fixtures:
        behind |= entries(fixture, eye, np.asarray(points_world, dtype=np.float64) - eye, MARGIN_M) <= 1.0
    return behind


def entries(
    fixture: Fixture, start_world: Float64Array, directions_world: Float64Array, margin_m: float
) -> Float64Array:
    """Where rays from `start_world` (3,) [m] along directions (K, 3) enter a fixture that `margin_m` makes larger on
    every side, as multiples (K,) of the directions; inf where they miss."""
    R = rotation(fixture.T_world_foot)
    start, d = (start_world - fixture.T_world_foot.position_m) @ R, directions_world @ R
    if isinstance(fixture, Post):
        spans = [_in_circle(start, d, fixture.diameter_m / 2.0 + margin_m)]
        height_m = fixture.height_m
    else:
        halves = np.array(fixture.size_m[:2]) / 2.0 + margin_m
        spans = [_between(start[axis], d[:, axis], -half, half) for axis, half in enumerate(halves)]
        height_m = fixture.size_m[2]
    spans.append(_between(start[2], d[:, 2], -margin_m, height_m + margin_m))
    near, far = np.max([span[0] for span in spans], axis=0), np.min([span[1] for span in spans], axis=0)
    return np.where((near <= far) & (far >= 0.0), near, np.inf)


def _between(start: float, d: Float64Array, low: float, high: float) -> tuple[Float64Array, Float64Array]:
    """Where rays enter and leave the space between two parallel planes."""
    steep = np.where(np.abs(d) < _PARALLEL, _PARALLEL, d)
    ends = (low - start) / steep, (high - start) / steep
    return np.minimum(*ends), np.maximum(*ends)


def _in_circle(start: Float64Array, d: Float64Array, radius_m: float) -> tuple[Float64Array, Float64Array]:
    """Where rays enter and leave an upright cylinder around the z axis; never where they miss it."""
    a = np.maximum(np.sum(d[:, :2] ** 2, axis=1), _PARALLEL)
    b, c = d[:, :2] @ start[:2], float(start[:2] @ start[:2]) - radius_m**2
    discriminant = b * b - a * c
    root = np.sqrt(np.maximum(discriminant, 0.0))
    missed = discriminant < 0.0
    return np.where(missed, np.inf, (-b - root) / a), np.where(missed, -np.inf, (-b + root) / a)


def fixture_depth_m(
    fixture: Fixture, camera: CameraCalibration, *, scale: int = 1, margin_m: float = 0.0
) -> Float64Array:
    """Depth (height / scale, width / scale) [m] of a fixture in every `scale`-th pixel; inf where it is not seen."""
    rows, columns = -(-camera.height_px // scale), -(-camera.width_px // scale)
    depth = np.full((rows, columns), np.inf)
    corners = project(fixture.corners_world, camera)
    if np.any(corners.depth_m <= 0.0):
        return depth  # a camera stands over the table
    reach = margin_m * camera.fx_px / corners.depth_m.min() + scale
    low = np.clip((corners.pixels.min(axis=0) - reach) // scale, 0, [columns, rows]).astype(np.int64)
    high = np.clip((corners.pixels.max(axis=0) + reach) // scale + 2, 0, [columns, rows]).astype(np.int64)
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
    middles = (np.column_stack([u.ravel(), v.ravel()]) + 0.5) * scale - 0.5
    directions = rays(middles, camera) @ rotation(camera.T_world_camera).T  # of depth 1
    entered = entries(fixture, camera.T_world_camera.position_m, directions, margin_m)
    depth[low[1] : high[1], low[0] : high[0]] = entered.reshape(u.shape)
    return depth


def with_fixtures(occlusion: Occlusion, fixtures: Sequence[Fixture], camera: CameraCalibration) -> Occlusion:
    """An occlusion map with fixtures, and finer because of them; unchanged without fixtures."""
    if not fixtures:
        return occlusion
    # Who reads the map takes neighbouring cells for hidden too: of the coarse map, the coarse ones.
    widened = np.asarray(minimum_filter(occlusion.depth_m, 3, mode="nearest"), dtype=np.float32)
    finer = occlusion.scale // _SCALE
    rows, columns = -(-camera.height_px // _SCALE), -(-camera.width_px // _SCALE)
    depth: Float32Array = widened.repeat(finer, axis=0).repeat(finer, axis=1)[:rows, :columns]
    for fixture in fixtures:
        hidden_m = fixture_depth_m(fixture, camera, scale=_SCALE, margin_m=MARGIN_M)
        depth = np.minimum(depth, hidden_m.astype(np.float32))
    return Occlusion(depth_m=depth, scale=_SCALE)


def fixtures_outline(fixtures: Sequence[Fixture], camera: CameraCalibration, margin_m: float) -> BoolArray:
    """Pixels (height, width) that show a fixture, widened by `margin_m` [m]."""
    outline = np.zeros((camera.height_px, camera.width_px), dtype=np.bool_)
    for fixture in fixtures:
        outline |= np.isfinite(fixture_depth_m(fixture, camera, margin_m=margin_m))
    return outline
