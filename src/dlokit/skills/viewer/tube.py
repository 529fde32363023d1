"""A round tube around a polyline, as a triangle mesh."""

import numpy as np

from dlokit import geometry
from dlokit.types.arrays import Float32Array, Float64Array, Int64Array


def tube_vertices(nodes: Float64Array, radius_m: float, sides: int) -> Float32Array:
    """Vertices (K * sides + 2, 3) [m] of a tube around the polyline `nodes` (K, 3) [m]: a ring a node, then both ends.

    The rings are turned as little as possible from one node to the next, so that the tube is not twisted.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])  # (sides, 2)
    directions = geometry.tangents(nodes)
    normal = _any_normal(directions[0])
    rings = np.empty((len(nodes), sides, 3))
    for index, (node, direction) in enumerate(zip(nodes, directions, strict=True)):
        normal = normal - np.dot(normal, direction) * direction
        length = np.linalg.norm(normal)
        normal = normal / length if length > 1e-6 else _any_normal(direction)
        basis = np.stack([normal, np.cross(direction, normal)])  # (2, 3)
        rings[index] = node + radius_m * circle @ basis
    return np.concatenate([rings.reshape(-1, 3), nodes[[0, -1]]]).astype(np.float32)


def tube_faces(count: int, sides: int) -> Int64Array:
    """Triangles (2 * count * sides, 3) over `tube_vertices` of `count` nodes, closed, facing outwards."""
    ring = np.arange(sides)
    following = (ring + 1) % sides
    start = (np.arange(count - 1) * sides)[:, None]
    a, b, c, d = start + ring, start + following, start + sides + ring, start + sides + following
    walls = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    first, last = count * sides, count * sides + 1
    end = (count - 1) * sides
    caps = np.concatenate(
        [
            np.column_stack([np.full(sides, first), following, ring]),
            np.column_stack([np.full(sides, last), end + ring, end + following]),
        ]
    )
    return np.concatenate([walls, caps])


def _any_normal(direction: Float64Array) -> Float64Array:
    """A unit vector (3,) across `direction` (3,)."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(direction))] = 1.0
    across: Float64Array = np.cross(direction, axis)
    return across / max(float(np.linalg.norm(across)), 1e-12)
