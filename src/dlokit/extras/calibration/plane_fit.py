"""A plane in a cloud that also shows other objects, and the table's frame from that plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.errors import SkillFailure
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.pose import Pose

FEWEST_POINTS = 200
"""Least number of points in the box for a fit."""
_LEAST_AGREEING = 0.5
"""Least fraction of the points on the plane: objects on it must cover less than the rest."""
_NEAR_M = 0.008
"""Largest distance of a point that counts for a candidate plane [m]: twice the noise of a stereo camera at 1 m."""
_CANDIDATES = 200
"""Number of planes through three points each; with half the points on the plane, none fits with probability 2e-12."""
_ROUNDS = 5
_STEEPEST = 0.7
"""Cosine between the normal and the z axis of the frame, below which a plane is a wall: 45°."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneFit:
    """A plane n · p = d through most points of a cloud."""

    normal: Float64Array  # (3,) of length 1, upwards
    distance_m: float
    """d, the height of the plane over the origin, along the normal [m]."""
    rms_m: float
    """Root mean square of the distances of the points on it [m]."""
    points: int
    """Number of those points."""

    @property
    def frame(self) -> Pose:
        """The table's frame: z is the normal, the origin is on the z axis of the cloud's frame, x turned least."""
        x = np.array([1.0, 0.0, 0.0]) - self.normal[0] * self.normal
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(self.normal, x), self.normal])
        return geometry.pose_from_matrix(geometry.homogeneous(R, (0.0, 0.0, self.distance_m / self.normal[2])))

    @property
    def tilt_rad(self) -> float:
        """Angle between the plane and the horizontal one of the cloud's frame [rad]."""
        return float(np.arccos(np.clip(self.normal[2], -1.0, 1.0)))


def fit_plane(points: ArrayLike) -> PlaneFit:
    """The plane through most points (N, 3) [m], fitted to these. Raises `SkillFailure` few_points or no_plane."""
    cloud = np.asarray(points, dtype=np.float64)
    if len(cloud) < FEWEST_POINTS:
        raise SkillFailure(
            "few_points",
            f"the box holds {len(cloud)} points, at least {FEWEST_POINTS} are needed; drag its corners so that it "
            "holds bare table",
        )
    near: BoolArray = _most_agreed(cloud)
    normal, middle, distances = np.zeros(3), np.zeros(3), np.zeros(0)
    for _ in range(_ROUNDS):
        middle = cloud[near].mean(axis=0)
        normal = np.linalg.svd(cloud[near] - middle, full_matrices=False)[2][-1]
        distances = (cloud - middle) @ normal
        sigma_m = 1.4826 * float(np.median(np.abs(distances[near])))
        near = np.asarray(np.abs(distances) < max(3.0 * sigma_m, 1e-4), dtype=np.bool_)
    normal *= np.sign(normal[2]) or 1.0
    count = int(np.count_nonzero(near))
    if count < _LEAST_AGREEING * len(cloud) or normal[2] < _STEEPEST:
        raise SkillFailure(
            "no_plane",
            f"{count / len(cloud):.0%} of the points in the box lie on one plane, which is "
            f"{np.degrees(np.arccos(normal[2])):.0f}° from level; at least {_LEAST_AGREEING:.0%} and at most 45° are "
            "needed: drag the corners so that the box holds bare table and little else",
        )
    return PlaneFit(
        normal=normal,
        distance_m=float(normal @ middle),
        rms_m=float(np.sqrt(np.mean(distances[near] ** 2))),
        points=count,
    )


def _most_agreed(cloud: Float64Array) -> BoolArray:
    """Which points (N,) are near to the best of many planes through three points of the cloud (RANSAC)."""
    rng = np.random.default_rng(0)
    some = cloud[rng.permutation(len(cloud))[:2000]]
    corners = some[rng.integers(0, len(some), (_CANDIDATES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = np.einsum("ki,ki->k", normals, corners[:, 0])
    agree = np.abs(some @ normals.T - offsets) < _NEAR_M
    # Three collinear points do not determine a plane.
    best = int(np.argmax(np.where(np.linalg.norm(normals, axis=1) > 0.5, agree.sum(axis=0), 0)))
    return np.abs(cloud @ normals[best] - offsets[best]) < _NEAR_M
