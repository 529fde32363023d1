"""Cleans a cloud: box, depth of the centre line, outliers, thinning. Without OpenCV, for clouds of any origin."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.skills.perception.config import BoxConfig
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.image import CameraCalibration

MOST_PIXELS = 50_000
"""Maximum number of pixels for a cloud, so that a large or near DLO takes no more time."""


def drawn(mask: BoolArray) -> Int64Array:
    """Rows and columns (2, N) of the pixels of a mask (height, width); of more than `MOST_PIXELS`, of each n-th one."""
    pixels = np.array(np.nonzero(mask))
    return pixels[:, :: 1 + pixels.shape[1] // MOST_PIXELS]


def inside_box(points_world: NDArray[np.floating], box: BoxConfig) -> BoolArray:
    """Whether each point (N, 3) [m] is in the box, its faces included, (N,)."""
    lower, upper = np.array(box.lower_world), np.array(box.upper_world)
    return np.all((points_world >= lower) & (points_world <= upper), axis=1)


def to_centre_line(
    points_world: Float64Array, camera: CameraCalibration, radius_m: float, table_height_m: float | None
) -> Float64Array:
    """Surface points (N, 3) [m] moved away from the camera by the DLO's radius, but never into the table.

    The table stops the centre line one radius above it; a point below is moved back along its line of sight, on
    which a stereo camera errs most. Without a table (None), points have no lower limit.
    """
    eye = camera.T_world_camera.position_m
    view = points_world - eye
    distance = np.linalg.norm(view, axis=1, keepdims=True)
    centred = points_world + view * (radius_m / np.maximum(distance, 1e-9))
    if table_height_m is None:
        return centred
    lowest = table_height_m + radius_m
    drop = centred[:, 2] - eye[2]
    sunk = (centred[:, 2] < lowest) & (drop < -1e-6)
    scale = np.where(sunk, (lowest - eye[2]) / np.where(sunk, drop, 1.0), 1.0)
    return eye + (centred - eye) * scale[:, None]


OUTLIER_RADIUS_M = 0.012
OUTLIER_VOXELS = 3.0
OUTLIER_NEIGHBOURS = 4
"""Points with fewer neighbours than this within `OUTLIER_RADIUS_M` [m] are outliers; for thinned points, within
`OUTLIER_VOXELS` cubes if these reach farther: a point on a thin DLO has two cubes on each side."""


def clean(points_world: Float64Array, voxel_m: float) -> Float64Array:
    """Points (N, 3) [m] without outliers, thinned to cubes of side `voxel_m` [m].

    Recorded clouds are cleaned by the same function before an observer gets them.
    """
    return thin(points_world[~lonely(points_world)], voxel_m)


def lonely(points_world: Float64Array, voxel_m: float = 0.0) -> BoolArray:
    """Whether each point (N, 3) [m] has too few neighbours, (N,); of points thinned to cubes of side `voxel_m` [m]."""
    if len(points_world) == 0:
        return np.zeros(len(points_world), dtype=np.bool_)
    # The nearest point is the point itself. Counting all neighbours takes ten times as long in dense clouds.
    within_m = max(OUTLIER_RADIUS_M, OUTLIER_VOXELS * voxel_m)
    nearest_m, _ = KDTree(points_world).query(points_world, OUTLIER_NEIGHBOURS + 1, distance_upper_bound=within_m)
    return ~np.isfinite(nearest_m[:, -1])


def thin(points_world: Float64Array, voxel_m: float) -> Float64Array:
    """The mean of the points (N, 3) [m] in each cube of side `voxel_m`, in an order that repeats."""
    if voxel_m <= 0.0 or len(points_world) == 0:
        return points_world
    cells = np.floor(points_world / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    extent = cells.max(axis=0) + 1
    keys = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    unique, member = np.unique(keys, return_inverse=True)
    counts = np.bincount(member, minlength=len(unique))
    sums = [np.bincount(member, weights=points_world[:, axis], minlength=len(unique)) for axis in range(3)]
    return np.column_stack(sums) / counts[:, None]
