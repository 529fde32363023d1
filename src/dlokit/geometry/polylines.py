"""Polylines: the nodes of a DLO as a curve in space."""

import numpy as np
from numpy.typing import ArrayLike

from dlokit.types.arrays import Float64Array


def arc_lengths(nodes: ArrayLike) -> Float64Array:
    """Arc length (K,) [m] at each point of a polyline (K, d) [m], from 0."""
    steps = np.linalg.norm(np.diff(np.asarray(nodes, dtype=np.float64), axis=0), axis=1)
    return np.concatenate(([0.0], np.cumsum(steps)))


def resample(nodes: ArrayLike, count: int) -> Float64Array:
    """Resample a polyline (K, d) [m] at `count` points with equal arc-length spacing, (count, d)."""
    points = np.asarray(nodes, dtype=np.float64)
    s = arc_lengths(points)
    wanted = np.linspace(0.0, s[-1], count)
    return np.column_stack([np.interp(wanted, s, points[:, axis]) for axis in range(points.shape[1])])


def tangents(nodes: ArrayLike) -> Float64Array:
    """Unit tangents (K, d) of a polyline by central differences."""
    gradient = np.gradient(np.asarray(nodes, dtype=np.float64), axis=0)
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def segment_near(nodes: ArrayLike, point: ArrayLike) -> int:
    """Index of the segment of a polyline (K, d) [m] nearest to a point (d,) [m], 0 to K - 2; the first of equally near
    ones."""
    points, wanted = np.asarray(nodes, dtype=np.float64), np.asarray(point, dtype=np.float64)
    begins, along = points[:-1], np.diff(points, axis=0)
    squares = np.maximum(np.sum(along**2, axis=1), np.finfo(np.float64).tiny)
    fraction = np.clip(np.sum((wanted - begins) * along, axis=1) / squares, 0.0, 1.0)
    return int(np.argmin(np.linalg.norm(begins + fraction[:, None] * along - wanted, axis=1)))


def rmse_m(nodes: ArrayLike, goal: ArrayLike, *, ends_interchangeable: bool = False) -> float:
    """Root mean square distance from node i to goal node i [m], both (M, 3).

    With `ends_interchangeable`, the reversed order of nodes also counts, and the smaller error is returned.
    """
    a, b = np.asarray(nodes, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    forward = float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))
    if not ends_interchangeable:
        return forward
    return min(forward, float(np.sqrt(np.mean(np.sum((a[::-1] - b) ** 2, axis=1)))))
