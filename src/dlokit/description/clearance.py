"""Room between a curve on the table and the fixtures that stand there."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.scene import Fixture, Post
from dlokit.types.arrays import Float64Array

_STEP_M = 0.001  # distance of the points at which a curve is compared with a fixture: errors stay below 0.1 mm


def clearances_m(nodes_world: ArrayLike, fixtures: Sequence[Fixture]) -> Float64Array:
    """Smallest distance (F,) [m] of a curve (K, 3) [m] from the surface of each fixture; below 0 inside it."""
    count = 2 + int(geometry.arc_lengths(nodes_world)[-1] / _STEP_M)
    points = geometry.resample(np.asarray(nodes_world, dtype=np.float64), count)
    return np.array([distances_m(points, fixture).min() for fixture in fixtures])


def clear_of(nodes_world: ArrayLike, fixtures: Sequence[Fixture], margin_m: float) -> bool:
    """Whether a curve (K, 3) [m] is at least `margin_m` away from every fixture; a DLO's curve is its centre line."""
    return bool(np.all(clearances_m(nodes_world, fixtures) >= margin_m))


def distances_m(points: Float64Array, fixture: Fixture) -> Float64Array:
    """Distances (N,) [m] of points (N, 3) [m] from a fixture's surface; negative inside.

    A fixture stands on the table: its sides and its top are its surface.
    """
    x, y, z = geometry.transform(geometry.inverse(fixture.T_world_foot), points).T
    if isinstance(fixture, Post):
        beyond = [np.hypot(x, y) - fixture.diameter_m / 2.0, z - fixture.height_m]
    else:
        half = np.array(fixture.size_m) / 2.0
        beyond = [np.abs(x) - half[0], np.abs(y) - half[1], z - fixture.size_m[2]]
    outside = np.column_stack(beyond)  # (N, 2) or (N, 3), past each pair of faces [m]
    return np.linalg.norm(np.maximum(outside, 0.0), axis=1) + np.minimum(outside.max(axis=1), 0.0)
