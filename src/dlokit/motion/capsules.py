"""Capsules around the links of an arm, all points within a radius of a segment, and their distances. Pure."""

from dataclasses import dataclass

import numpy as np

from dlokit.types.arrays import Float64Array


@dataclass(frozen=True)
class Capsules:
    """Capsules of any shape (…) in the world: both ends of each and its radius."""

    starts_world: Float64Array  # (…, 3) [m]
    ends_world: Float64Array  # (…, 3) [m]
    radii_m: Float64Array  # (…) [m], or what broadcasts to it


def capsule_distances(first: Capsules, second: Capsules) -> Float64Array:
    """Distances (…) [m] between the surfaces of capsules, pair by pair; negative where two overlap."""
    between = segment_distances(first.starts_world, first.ends_world, second.starts_world, second.ends_world)
    return between - first.radii_m - second.radii_m


def segment_distances(a0: Float64Array, a1: Float64Array, b0: Float64Array, b1: Float64Array) -> Float64Array:
    """Distances between segments a and b (…, 3) [m], pair by pair; Ericson, Real-Time Collision Detection, 5.1.9."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    pairs = ((u, u), (v, v), (u, v), (u, w), (v, w))
    uu, vv, uv, uw, vw = (np.einsum("...i,...i->...", first, second) for first, second in pairs)
    determinant = uu * vv - uv**2
    # Parallel segments: any point of the first is valid, the clamps below correct the other.
    s = np.where(determinant > 1e-12, (uv * vw - vv * uw) / np.maximum(determinant, 1e-12), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / vv).clip(0.0, 1.0)
    s = ((uv * t - uw) / uu).clip(0.0, 1.0)
    return np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
