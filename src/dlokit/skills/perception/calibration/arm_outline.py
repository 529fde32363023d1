"""Predicts the arm's outline in a picture: its meshes are posed by forward kinematics and drawn with depth.

Only the last links count, which are in front of the table; the other links are used as occluders. The fingers do not
count, because their width is less certain than the hand's pose.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel
from dlokit.geometry.camera import back_project, project
from dlokit.motion.forward_kinematics import PosedArm, link_transforms
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration

_FINE = 2
"""Drawn pixels per camera pixel, along each side: an outline is then accurate to a quarter of a camera pixel."""
_SPACING_PX = 2
"""Distance of the points along an outline [px]."""
_SMOOTH_PX = 2.0
"""Standard deviation of the blur that gives an outline its normals [px]."""
_CLEAR_PX = 14
"""Minimum distance from a point of the outline to other parts of the arm, and to the border of the picture [px]."""
_NEAREST_M = 0.1
"""A link nearer to the camera than this is not drawn [m]."""
_DRAWN_JOINTS, _COUNTED_JOINTS = 5, 3
"""Links of the last joints that are drawn, and whose outline counts."""


@dataclass(frozen=True, kw_only=True)
class Outline:
    """K points on the outline of the arm, at their believed positions."""

    points_world: Float64Array  # (K, 3) [m] on the arm's surface
    pixels: Float64Array  # (K, 2) u, v [px]
    normals: Float64Array  # (K, 2) away from the arm in the picture, of length 1
    turns_with_hand: BoolArray  # (K,) whether it is on a part that the last joint turns


@dataclass(frozen=True, kw_only=True)
class _Drawing:
    """A picture of the arm, `_FINE` times finer than the camera's."""

    owner: UInt8Array  # (H, W) 1 + index of the visible link; 0: no link
    depth_m: Float32Array  # (H, W) along z of the camera [m]


def arm_outline(robot: PosedArm, camera: CameraCalibration) -> Outline:
    """The outline of an arm in the (rectified) picture of `camera`. Raises `MachineError` without its meshes."""
    arm = robot.arm
    drawing = _drawn(robot, camera)
    mask = (drawing.owner > 0).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    stride = _SPACING_PX * _FINE
    at = np.concatenate([np.zeros((0, 2), np.int64), *(contour[::stride, 0] for contour in contours)]).astype(np.int64)
    normals = _normals(mask, at)
    keep = _standing_free(mask, at, normals)
    keep &= np.isin(
        drawing.owner[at[:, 1], at[:, 0]], [_label(arm, link) for link in _last_links(arm, _COUNTED_JOINTS)]
    )
    at, normals = at[keep], normals[keep]
    # A contour runs through the middle of the outermost pixels of the arm, half a pixel within its edge.
    pixels = (at + 0.5 + 0.5 * normals) / _FINE - 0.5
    owner = drawing.owner[at[:, 1], at[:, 0]]
    return Outline(
        points_world=back_project(pixels, drawing.depth_m[at[:, 1], at[:, 0]], camera),
        pixels=pixels,
        normals=normals,
        turns_with_hand=np.isin(owner, [_label(arm, link) for link in _last_links(arm, 1)]),
    )


def load_kernels() -> None:
    """Compile the kernels before the first look needs them."""
    _draw(np.zeros((1, 3, 3)), 1, np.zeros((2, 2), dtype=np.uint8), np.zeros((2, 2), dtype=np.float32))


def _last_links(arm: ArmModel, joints: int) -> tuple[str, ...]:
    """The links of the last joints, and the hand."""
    return (*(joint.link for joint in arm.joints[-joints:]), HAND)


def _label(arm: ArmModel, link: str) -> int:
    return arm.links.index(link) + 1


def _drawn(robot: PosedArm, camera: CameraCalibration) -> _Drawing:
    arm, state = robot.arm, robot.state
    frames = link_transforms(arm, state.q_rad, state.finger_width_m, state.T_world_base)[0]
    size = (camera.height_px * _FINE, camera.width_px * _FINE)
    owner, depth_m = np.zeros(size, dtype=np.uint8), np.full(size, np.inf, dtype=np.float32)
    for link in (*_last_links(arm, _DRAWN_JOINTS), *FINGER_LINKS):
        T, triangles = frames[arm.links.index(link)], _triangles(arm, link)
        seen = project(triangles.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3], camera)
        if np.all(seen.depth_m > _NEAREST_M):
            corners = np.column_stack([(seen.pixels + 0.5) * _FINE - 0.5, seen.depth_m])
            _draw(corners.reshape(-1, 3, 3), _label(arm, link), owner, depth_m)
    return _Drawing(owner=owner, depth_m=depth_m)


@cache
def _triangles(arm: ArmModel, link: str) -> Float64Array:
    """Corners (T, 3, 3) [m] of a link's mesh, in its frame."""
    from dlokit.description.arm.fitting import link_mesh  # trimesh takes a quarter of a second to load

    return np.asarray(link_mesh(arm, link, merged=False).triangles, dtype=np.float64)


def _normals(mask: UInt8Array, at: NDArray[np.int64]) -> Float64Array:
    """Unit normals (K, 2) of the mask's edge at pixels (K, 2), outwards."""
    soft = np.asarray(cv2.GaussianBlur(mask * 255, (0, 0), _SMOOTH_PX * _FINE))
    slopes = [np.asarray(cv2.Sobel(soft, cv2.CV_32F, *order, ksize=3)) for order in ((1, 0), (0, 1))]
    outwards = -np.stack([slope[at[:, 1], at[:, 0]] for slope in slopes], axis=1).astype(np.float64)
    return outwards / np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-9)


def _standing_free(mask: UInt8Array, at: NDArray[np.int64], normals: Float64Array) -> BoolArray:
    """Whether the table is visible beside each point (K,), at a distance from the picture's border."""
    size = np.array(mask.shape[::-1])
    reach = _CLEAR_PX * _FINE
    keep = np.all((at >= reach) & (at < size - reach), axis=1)
    for step in range(2 * _FINE, reach, _FINE):
        beside = np.clip(np.round(at + normals * step).astype(np.int64), 0, size - 1)
        keep &= mask[beside[:, 1], beside[:, 0]] == 0
    return keep


@njit(cache=True)
def _draw(triangles: Float64Array, label: int, owner: UInt8Array, depth_m: Float32Array) -> None:
    """Draw triangles (T, 3, 3) of u, v [px], depth [m]; nearer surfaces hide farther ones.

    MuJoCo's renderer would need OpenGL on the camera's machine, which may lack it in a lab.
    """
    height, width = owner.shape
    for index in range(len(triangles)):
        a, b, c = triangles[index, 0], triangles[index, 1], triangles[index, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-12:
            continue
        first_u = max(int(np.ceil(min(a[0], b[0], c[0]))), 0)
        last_u = min(int(np.floor(max(a[0], b[0], c[0]))), width - 1)
        first_v = max(int(np.ceil(min(a[1], b[1], c[1]))), 0)
        last_v = min(int(np.floor(max(a[1], b[1], c[1]))), height - 1)
        for v in range(first_v, last_v + 1):
            for u in range(first_u, last_u + 1):
                share_b = ((u - a[0]) * (c[1] - a[1]) - (v - a[1]) * (c[0] - a[0])) / area
                share_c = ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) / area
                if share_b < 0.0 or share_c < 0.0 or share_b + share_c > 1.0:
                    continue
                z = a[2] + share_b * (b[2] - a[2]) + share_c * (c[2] - a[2])
                if z < depth_m[v, u]:
                    depth_m[v, u] = z
                    owner[v, u] = label
