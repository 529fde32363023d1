"""Fits a link's shape: a few capsules close to its surface, and the mesh to draw, made of capsules if it has none."""

import itertools
from functools import cache

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from dlokit.description.arm.model import ArmModel, Capsule, Vector
from dlokit.types.arrays import Float64Array

_MOST = 3
"""Most capsules of a link."""
_WORTH = 0.8
"""A further capsule must reduce the total volume to less than this fraction."""
_LEAST_RADIUS_M = 0.005
_LEAST_LENGTH_M = 0.001  # a capsule without a length has no direction
_ROUNDS = 60  # of the search for the narrowest cylinder about an axis


def capsules_around(link: str, points: Float64Array) -> tuple[Capsule, ...]:
    """Capsules that enclose all points (N, 3) [m] of a link's surface; empty without points.

    The link is cut into slabs of equal length along its longest direction, each with the smallest capsule whose axis is
    one of the link's or of the slab's principal directions.
    """
    if len(points) == 0:
        return ()
    best = [_smallest(link, points)]
    along = points @ _directions(points)[0]
    for count in range(2, _MOST + 1):
        edges = np.linspace(along.min(), along.max() + 1e-9, count + 1)
        slabs = [points[(along >= low) & (along <= high)] for low, high in itertools.pairwise(edges)]
        cut = [_smallest(link, slab) for slab in slabs if len(slab)]
        if sum(map(_volume_m3, cut)) < _WORTH * sum(map(_volume_m3, best)):
            best = cut
    return tuple(best)


def _smallest(link: str, points: Float64Array) -> Capsule:
    """The smallest of the capsules about a few directions."""
    corners = _corners(points)
    return min((_about(link, corners, axis) for axis in (*np.eye(3), *_directions(points))), key=_volume_m3)


def _corners(points: Float64Array) -> Float64Array:
    """The points on the convex hull: a capsule is convex, so that it encloses the remaining points too."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):  # flat, or fewer than four
        return points


def _directions(points: Float64Array) -> Float64Array:
    """Principal directions (3, 3) as rows, the longest first."""
    return np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]


def _about(link: str, points: Float64Array, axis: Float64Array) -> Capsule:
    """The capsule about an axis (3,): the narrowest cylinder around the points, cut as short as its caps allow."""
    across = np.linalg.svd(axis[None, :])[2][1:]  # (2, 3)
    flat = points @ across.T
    center = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    for step in range(1, _ROUNDS):  # Badoiu and Clarkson: move towards the farthest point, less each time
        away = flat - center
        center = center + away[np.argmax(np.einsum("ij,ij->i", away, away))] / (step + 1)
    distance = np.linalg.norm(flat - center, axis=1)
    radius_m = max(float(distance.max()), _LEAST_RADIUS_M)
    along, cap = points @ axis, np.sqrt(np.maximum(radius_m**2 - distance**2, 0.0))
    low, high = float(np.min(along + cap)), float(np.max(along - cap))
    if high - low < _LEAST_LENGTH_M:  # a ball encloses them
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * _LEAST_LENGTH_M, middle + 0.5 * _LEAST_LENGTH_M
        beyond = np.maximum(np.abs(along - middle) - 0.5 * _LEAST_LENGTH_M, 0.0)
        radius_m = float(np.max(np.hypot(distance, beyond)))
    base = center @ across
    return Capsule(link=link, start_m=_vector(base + low * axis), end_m=_vector(base + high * axis), radius_m=radius_m)


def _volume_m3(capsule: Capsule) -> float:
    length_m = float(np.linalg.norm(np.subtract(capsule.end_m, capsule.start_m)))
    return np.pi * capsule.radius_m**2 * (length_m + 4.0 / 3.0 * capsule.radius_m)


def _vector(values: Float64Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)


_SEGMENTS = (16, 16)  # of a drawn capsule


@cache
def link_mesh(arm: ArmModel, link: str, *, merged: bool) -> trimesh.Trimesh:
    """One mesh of a link, in its frame [m]; with `merged` equal vertices are one, as smooth shading needs.

    Raises `MachineError` when the package of the arm's meshes is not installed.
    """
    surfaces = arm.surfaces.get(link, ())
    if not surfaces:
        return _joined([_capsule_mesh(each) for each in arm.capsules if each.link == link])
    parts: list[trimesh.Trimesh] = []
    for surface in surfaces:
        mesh = trimesh.load_mesh(surface.path, process=merged)
        assert isinstance(mesh, trimesh.Trimesh), f"{surface.path} holds {type(mesh).__name__}, not one mesh"
        if not np.array_equal(surface.T_link_mesh, np.eye(4)):
            mesh.apply_transform(surface.T_link_mesh)
        parts.append(mesh)
    return parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    whole = trimesh.util.concatenate(parts)
    assert isinstance(whole, trimesh.Trimesh), "meshes make a mesh"
    return whole


def _capsule_mesh(capsule: Capsule) -> trimesh.Trimesh:
    start, end = np.array(capsule.start_m), np.array(capsule.end_m)
    length_m = float(np.linalg.norm(end - start))
    mesh = trimesh.creation.capsule(height=length_m, radius=capsule.radius_m, count=_SEGMENTS)
    along = (end - start) / length_m if length_m > 0.0 else np.array([0.0, 0.0, 1.0])
    mesh.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], along))
    mesh.apply_translation(0.5 * (start + end))
    return mesh
