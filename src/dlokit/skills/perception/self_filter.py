"""Masks the pixels in which the DLO may be: in the box, and neither on the robot nor behind it."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.geometry import rotation
from dlokit.geometry.camera import project, rays
from dlokit.motion.collisions import Capsules
from dlokit.motion.forward_kinematics import PosedArm, capsule_ends
from dlokit.skills.perception.config import BoxConfig
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import Occlusion

PICTURE_MARGIN_M = 0.006
"""Margin by which the robot is wider than its capsules in the picture [m]."""
SPACE_MARGIN_M = 0.006
"""Points nearer to the robot's capsules than this are the robot's [m]."""
OCCLUSION_SCALE = 8
"""Camera pixels per cell of the published occlusion map, along each side."""


def robot_capsules(robots: Sequence[PosedArm]) -> Capsules:
    """The robots' shape as C capsules, computed from their joint angles and finger widths."""
    states = [(robot.arm, robot.state) for robot in robots]
    ends = [
        capsule_ends(arm, state.q_rad, state.finger_width_m, T_world_base=state.T_world_base)  # of one configuration
        for arm, state in states
    ]
    nowhere = np.zeros((0, 3))
    return Capsules(
        starts_world=np.concatenate([nowhere, *(start[0] for start, _ in ends)]),
        ends_world=np.concatenate([nowhere, *(end[0] for _, end in ends)]),
        radii_m=np.concatenate([np.zeros(0), *(arm.radii_m for arm, _ in states)]),
    )


_RIM = np.column_stack([np.cos(np.linspace(0, 2 * np.pi, 24)), np.sin(np.linspace(0, 2 * np.pi, 24))])


def robot_outline(capsules: Capsules, camera: CameraCalibration, margin_m: float) -> BoolArray:
    """Pixels (height, width) that show the robot, widened by `margin_m`."""
    outline = np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)
    a, b = project(capsules.starts_world, camera), project(capsules.ends_world, camera)
    radii = capsules.radii_m + margin_m
    nearest = np.minimum(a.depth_m, b.depth_m)
    for index in np.flatnonzero(nearest > 2.0 * radii):  # nearer ones have no outline; a camera is never there
        radius = radii[index]
        rim = np.concatenate(
            [end.pixels[index] + _RIM * (radius * camera.fx_px / end.depth_m[index]) for end in (a, b)]
        )
        hull = cv2.convexHull(np.clip(np.round(rim), -10_000, 10_000).astype(np.int32))
        cv2.fillConvexPoly(outline, hull, (1.0,))
    return outline > 0


def robot_distance_m(points_world: NDArray[np.floating], capsules: Capsules) -> Float64Array:
    """Distance of points (N, 3) [m] to the nearest capsule's surface, (N,); negative inside, inf without a robot."""
    points = np.asarray(points_world, dtype=np.float64)
    nearest = np.full(len(points), np.inf)
    for start, end, radius in zip(capsules.starts_world, capsules.ends_world, capsules.radii_m, strict=True):
        axis = end - start
        along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius
        np.minimum(nearest, distance, out=nearest)
    return nearest


def occlusion_map(capsules: Capsules, camera: CameraCalibration, scale: int) -> Occlusion:
    """Depth of the capsules in every `scale`-th pixel, by casting a ray through the middle of each cell."""
    rows, columns = -(-camera.height_px // scale), -(-camera.width_px // scale)
    depth = np.full((rows, columns), np.inf, dtype=np.float32)
    a, b = project(capsules.starts_world, camera), project(capsules.ends_world, camera)
    R, position = rotation(camera.T_world_camera), camera.T_world_camera.position_m
    starts, ends = (capsules.starts_world - position) @ R, (capsules.ends_world - position) @ R
    nearest = np.minimum(a.depth_m, b.depth_m)
    for index in np.flatnonzero(nearest > 2.0 * capsules.radii_m):
        radius = float(capsules.radii_m[index])
        reach = radius * camera.fx_px / (nearest[index] - radius)
        both = np.array([a.pixels[index], b.pixels[index]])
        low = np.clip((both.min(axis=0) - reach) // scale, 0, [columns, rows]).astype(np.int64)
        high = np.clip((both.max(axis=0) + reach) // scale + 1, 0, [columns, rows]).astype(np.int64)
        if np.any(high <= low):
            continue
        v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
        middles = (np.column_stack([u.ravel(), v.ravel()]) + 0.5) * scale - 0.5
        hit = _ray_depth(rays(middles, camera), starts[index], ends[index], radius).reshape(u.shape)
        part = depth[low[1] : high[1], low[0] : high[0]]
        np.minimum(part, hit.astype(np.float32), out=part)
    return Occlusion(depth_m=depth, scale=scale)


def _ray_depth(directions: Float64Array, start: Float64Array, end: Float64Array, radius: float) -> Float64Array:
    """Depth (K,) [m] at which rays (K, 3) of z = 1 from the camera enter a capsule; inf where they miss.

    A ray enters the capsule where it enters the cylinder between its ends, or else one of the two end spheres.
    """
    axis = end - start
    length = float(np.linalg.norm(axis))
    along = axis / max(length, 1e-12)
    d_along, s_along = directions @ along, float(start @ along)
    across = directions - d_along[:, None] * along
    offset = start - s_along * along
    t = _first_root(np.sum(across**2, axis=1), across @ offset, float(offset @ offset) - radius**2)
    height = t * d_along - s_along
    cylinder = np.where((height >= 0.0) & (height <= length), t, np.inf)
    square = np.sum(directions**2, axis=1)
    spheres = [_first_root(square, directions @ center, float(center @ center) - radius**2) for center in (start, end)]
    return np.minimum(cylinder, np.minimum(spheres[0], spheres[1]))


def _first_root(a: Float64Array, b: Float64Array, c: float) -> Float64Array:
    """Smaller solution of ``a t² - 2 b t + c = 0``; inf without a solution."""
    discriminant = b * b - a * c
    valid = (discriminant >= 0.0) & (a > 1e-12)
    return np.where(valid, (b - np.sqrt(np.maximum(discriminant, 0.0))) / np.where(valid, a, 1.0), np.inf)


def box_outline(box: BoxConfig, camera: CameraCalibration) -> BoolArray:
    """Pixels (height, width) that may show the box: all pixels when the camera is within or beside it."""
    bounds = np.array([box.lower_world, box.upper_world])
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    seen = project(corners, camera)
    if np.any(seen.depth_m <= 0.0):
        return np.ones((camera.height_px, camera.width_px), dtype=np.bool_)
    outline = np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)
    hull = cv2.convexHull(np.clip(np.round(seen.pixels), -10_000, 10_000).astype(np.int32))
    cv2.fillConvexPoly(outline, hull, (1.0,))
    return outline > 0
