"""Estimates the camera's offset along the table from pictures of the robot's own hand, whose pose is exactly known.

The outline of the arm is drawn for the believed camera (`arm_outline`) and searched for in the picture's difference
to a picture without the arm. All points of all pictures give one weighted least-squares problem for

- the offset of the camera along x and y, and its turn about the vertical, which the table's plane cannot determine;
- its height and two tilts, which the table determines if it is level, and which are therefore held near these values.
They matter because the hand is above the table, and the offset is needed on the table;
- the offset of the hand from its model, in the tool's frame, and the apparent excess width of the arm. With the hand
turned by half a turn between two looks, the offset of the hand cancels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.errors import SkillFailure
from dlokit.geometry import rotation
from dlokit.geometry.camera import baseline_m, in_camera
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.calibration.arm_outline import Outline, arm_outline
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraCheck, CameraPictures, StereoImages
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

_BLUR_PX = 0.7
_STEP_PX = 0.5
_EDGE_SHARE = 0.15
"""Fraction of the difference within the arm that defines its edge: low, as rounded parts are dim at their edges."""
_LEAST_EDGE = 10.0
"""Differences below this are noise [grey levels]."""
_LEAST_DIFFERENCE = 25.0
"""The arm must differ from the table by this [grey levels]."""


@dataclass(frozen=True, kw_only=True)
class Edges:
    """Distance of the edge found from each of K points."""

    offsets_px: Float64Array  # (K,) along the normal, positive outwards
    found: BoolArray  # (K,)


def difference(picture: UInt8Array, background: UInt8Array) -> Float32Array:
    """Change of each pixel (height, width) [grey levels] between two pictures (height, width, 3)."""
    changed = np.asarray(cv2.absdiff(picture, background)).astype(np.float32).mean(axis=2)
    return np.asarray(cv2.GaussianBlur(changed, (0, 0), _BLUR_PX), dtype=np.float32)


def find_edges(changed: Float32Array, pixels: Float64Array, normals: Float64Array, reach_px: float) -> Edges:
    """The outermost edge of the changed area within `reach_px` of pixels (K, 2), along normals (K, 2)."""
    steps = np.arange(-reach_px, reach_px + 0.5 * _STEP_PX, _STEP_PX)
    places = (pixels[:, None] + normals[:, None] * steps[:, None]).astype(np.float32)
    profile = np.asarray(cv2.remap(changed, places[..., 0], places[..., 1], cv2.INTER_LINEAR), dtype=np.float64)
    within = np.median(profile[:, steps < -0.5 * reach_px], axis=1)
    beside = np.median(profile[:, steps > 0.7 * reach_px], axis=1)
    level = np.maximum(_EDGE_SHARE * within, _LEAST_EDGE)
    above = profile >= level[:, None]
    last = len(steps) - 1 - np.argmax(above[:, ::-1], axis=1)
    found = above.any(axis=1) & (last < len(steps) - 1) & (within > _LEAST_DIFFERENCE) & (beside < level)
    rows, last = np.arange(len(pixels)), np.minimum(last, len(steps) - 2)
    high, low = profile[rows, last], profile[rows, last + 1]
    share = (high - level) / np.maximum(high - low, 1e-6)
    return Edges(offsets_px=steps[last] + _STEP_PX * share, found=found)


FEW_POINTS, SCATTERED, TOO_FAR = "few_points", "scattered", "too_far"

_FAR_PX, _NEAR_PX = (12.0, 8.0), (6.0,)
"""Search distances from the predicted outline [px]: first from the believed camera pose, then from the corrected
pose, with the outline drawn again."""
_OF_CAMERA = np.array([True] * 6 + [False] * 3)
"""The unknowns that a new drawing can include."""
_REWEIGHTINGS = 10
_NOISE_PX = 1.6
"""Standard deviation of a point of the outline [px]; larger than the scatter, because neighbours err alike."""
_OUTLIER = 3.0
_LEAST_SCALE_PX = 0.1
LARGEST_OFFSET_M = 0.02
"""A larger correction along the table is rejected [m]."""
LARGEST_YAW_RAD = 0.02
"""A larger turn about the vertical is rejected [rad]."""
_LEAST_POINTS = 300
"""Minimum number of points of the arm's outline, over all pictures."""
_LARGEST_SCATTER_M = 0.0005
"""Largest accepted disagreement of the pictures after the correction (root mean square) [m]."""
_TILT_SIGMA_RAD = 0.0026
"""Standard deviation of the table's tilt about each axis [rad]."""
_HEIGHT_SIGMA_M = 0.0015
"""Standard deviation of the camera's height over the table [m]."""
_HAND_SIGMA_M = 0.001
"""Standard deviation of the hand's offset from its model, along each axis [m]."""


@dataclass(frozen=True, kw_only=True)
class HandLook:
    """Rectified pictures of the hand, and the state of the arm."""

    images: CameraPictures
    robot: PosedArm


@dataclass(frozen=True, kw_only=True)
class _Picture:
    """One picture and the outline predicted in it."""

    changed: Float32Array  # (height, width) against the background
    outline: Outline
    slopes: Float64Array  # (K, 9) change of the outline along its normals [px] by each unknown


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """The unknowns, and the agreement of the N found edges with them."""

    unknowns: Float64Array  # (9,) as in `_slopes`, relative to the drawing
    slopes: Float64Array  # (N, 9)
    errors_px: Float64Array  # (N,)
    weights: Float64Array  # (N,) 0 for outliers
    picture: NDArray[np.int64]  # (N,) index of its picture


def camera_from_hand(background: CameraPictures, looks: Sequence[HandLook]) -> CameraCheck:
    """Error of the assumed pose of the camera of `background`, in the table's plane at height 0.

    `background` are rectified pictures without the arm over the table, their pose corrected by the table. A depth
    camera gives one view, a pair gives two; depths are not used, because they are coarse at outlines. Raises
    `SkillFailure` few_points, scattered or too_far, if the observations are insufficient or implausible.
    """
    center = np.append(np.mean([look.robot.state.T_world_tcp.position_m[:2] for look in looks], axis=0), 0.0)
    nothing = np.zeros(9)
    rough = _fit(_pictures(background, looks, nothing, center), nothing, _FAR_PX)
    known = np.where(_OF_CAMERA, rough.unknowns, 0.0)
    fit = _fit(_pictures(background, looks, known, center), known, _NEAR_PX)
    camera = known + fit.unknowns
    check = CameraCheck(
        offset_m=camera[:2],
        yaw_rad=float(camera[2]),
        center_world=center[:2],
        scatter_m=_scatter_m(fit),
        points=int(np.count_nonzero(fit.weights)),
    )
    _hold(check)
    return check


def corrected_by(T_world_camera: Pose, check: CameraCheck) -> Pose:
    """A believed camera pose, corrected by the result of the hand check."""
    center = np.append(check.center_world, 0.0)
    return _moved(T_world_camera, np.append(check.offset_m, 0.0), np.array([0.0, 0.0, check.yaw_rad]), center)


def _moved(T: Pose, by_m: Float64Array, turn_rad: Float64Array, center: Float64Array) -> Pose:
    """A pose turned about a point `center` (3,) of the world by a rotation vector (3,), and then moved by (3,)."""
    turn = Rotation.from_rotvec(turn_rad)
    place = center + turn.apply(T.position_m - center) + by_m
    return geometry.pose(place, (turn * Rotation.from_quat(T.wxyz, scalar_first=True)).as_quat(scalar_first=True))


def _pictures(
    background: CameraPictures, looks: Sequence[HandLook], known: Float64Array, center: Float64Array
) -> list[_Picture]:
    """All pictures, with the outlines predicted from the present estimate (9,)."""
    camera = background.calibration
    shift_m, turn_rad = known[[0, 1, 3]], known[[4, 5, 2]]
    pose = _moved(camera.T_world_camera, shift_m, turn_rad, center)
    placed = msgspec.structs.replace(camera, T_world_camera=pose)
    return [
        _picture(look.robot, difference(picture, empty), camera, center)
        for look in looks
        for (picture, camera), (empty, _) in zip(_views(look.images, placed), _views(background, placed), strict=True)
    ]


def _picture(robot: PosedArm, changed: Float32Array, camera: CameraCalibration, center: Float64Array) -> _Picture:
    outline = arm_outline(robot, camera)
    return _Picture(changed=changed, outline=outline, slopes=_slopes(outline, robot.state, camera, center))


def _views(images: CameraPictures, camera: CameraCalibration) -> list[tuple[UInt8Array, CameraCalibration]]:
    """Each picture (height, width, 3) with its camera, the right one of a pair as a camera of its own."""
    if not isinstance(images, StereoImages):
        return [(images.reference, camera)]
    T = camera.T_world_camera
    beside = geometry.pose(T.position_m + baseline_m(camera) * rotation(T)[:, 0], T.wxyz)
    return [(images.left, camera), (images.right, msgspec.structs.replace(camera, T_world_camera=beside))]


def _slopes(outline: Outline, robot: RobotState, camera: CameraCalibration, center: Float64Array) -> Float64Array:
    """Change of an outline along its normals (K, 9) [px] by each unknown.

    The unknowns: the camera's offset x, y [m], its turn about z [rad], its height z [m], its tilts about x, y [rad];
    the hand's offset along the tool's x, y [m]; the arm's apparent excess width [px].
    """
    R, tool = rotation(camera.T_world_camera), rotation(robot.T_world_tcp)
    x, y, z = in_camera(outline.points_world, camera).T
    n_u, n_v = outline.normals.T * np.array([[camera.fx_px], [camera.fy_px]])
    # Of the pinhole camera: du = fx (dx / z - x dz / z²), the same for v; then from the camera's axes to the world's.
    by_point = np.column_stack([n_u / z, n_v / z, -(n_u * x + n_v * y) / z**2]) @ R.T
    by_turn = np.cross(outline.points_world - center, by_point)
    # For a camera moved along x, the scene moves in the opposite direction.
    camera_columns = -np.column_stack([by_point[:, :2], by_turn[:, 2], by_point[:, 2], by_turn[:, :2]])
    hand_columns = (by_point @ tool[:, :2]) * outline.turns_with_hand[:, None]
    return np.column_stack([camera_columns, hand_columns, np.ones(len(x))])


def _fit(pictures: Sequence[_Picture], known: Float64Array, reaches_px: Sequence[float]) -> _Fit:
    """Search for the outlines, fit, and search again nearer to the fit. Raises `SkillFailure` few_points."""
    fit = _Fit(
        unknowns=np.zeros(9),
        slopes=np.zeros((0, 9)),
        errors_px=np.zeros(0),
        weights=np.zeros(0),
        picture=np.zeros(0, dtype=np.int64),
    )
    for reach_px in reaches_px:
        offsets_px, slopes, picture = _search(pictures, fit.unknowns, reach_px)
        if len(offsets_px) < _LEAST_POINTS:
            raise SkillFailure(
                FEW_POINTS,
                f"{len(offsets_px)} points of the arm's outline were found, at least {_LEAST_POINTS} are "
                "needed; is the hand in the picture, and does it differ from the table?",
            )
        fit = _fitted(offsets_px, slopes, picture, known)
    return fit


def _search(
    pictures: Sequence[_Picture], unknowns: Float64Array, reach_px: float
) -> tuple[Float64Array, Float64Array, NDArray[np.int64]]:
    """The edges near the outlines that these unknowns predict.

    Their offsets (N,) [px] from the drawn outlines, the slopes of the offsets (N, 9), and their pictures' indices (N,).
    """
    offsets: list[Float64Array] = []
    slopes: list[Float64Array] = []
    for picture in pictures:
        moved_px = picture.slopes @ unknowns
        outline = picture.outline
        at = outline.pixels + moved_px[:, None] * outline.normals
        edges = find_edges(picture.changed, at, outline.normals, reach_px)
        offsets.append((edges.offsets_px + moved_px)[edges.found])
        slopes.append(picture.slopes[edges.found])
    numbers = np.repeat(np.arange(len(pictures)), [len(part) for part in offsets])
    return np.concatenate(offsets), np.concatenate(slopes), numbers


def _fitted(b: Float64Array, A: Float64Array, picture: NDArray[np.int64], known: Float64Array) -> _Fit:
    """The unknowns from offsets `b` (N,) and slopes `A` (N, 9): least squares with Tukey's weights, and priors.

    `scipy.optimize.least_squares(loss=...)` would apply its loss to the priors as well, and keep one scale: here each
    round takes the scale from the spread of the residuals.
    """
    tilt, hand = _TILT_SIGMA_RAD, _HAND_SIGMA_M
    prior = np.array([np.inf, np.inf, np.inf, _HEIGHT_SIGMA_M, tilt, tilt, hand, hand, np.inf]) ** -2.0
    unknowns, error, weights = np.zeros(9), b, np.ones(len(b))
    for _ in range(_REWEIGHTINGS):
        weighted = (A * weights[:, None]).T / _NOISE_PX**2
        # The drawing already includes the present estimate; the priors apply to the total.
        solution = np.linalg.lstsq(weighted @ A + np.diag(prior), weighted @ b - prior * known, rcond=None)[0]
        unknowns = np.asarray(solution, dtype=np.float64)
        error = b - A @ unknowns
        scale = max(1.4826 * float(np.median(np.abs(error))), _LEAST_SCALE_PX)
        weights = np.maximum(1.0 - (error / (_OUTLIER * scale)) ** 2, 0.0) ** 2
    return _Fit(unknowns=unknowns, slopes=A, errors_px=error, weights=weights, picture=picture)


def _scatter_m(fit: _Fit) -> float:
    """Remaining correction of the camera along the table by each picture alone, root mean square [m]."""
    left: list[Float64Array] = []
    for number in np.unique(fit.picture):
        mine = fit.picture == number
        root = np.sqrt(fit.weights[mine])
        A, b = fit.slopes[mine, :2] * root[:, None], fit.errors_px[mine] * root
        left.append(np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], dtype=np.float64))
    return float(np.sqrt(np.mean(np.sum(np.square(left), axis=1))))


def _hold(check: CameraCheck) -> None:
    """Raise `SkillFailure` for an implausible result."""
    if check.scatter_m > _LARGEST_SCATTER_M:
        raise SkillFailure(
            SCATTERED,
            f"the pictures disagree by {1e3 * check.scatter_m:.1f} mm, at most {1e3 * _LARGEST_SCATTER_M:.1f} mm "
            "are believed; did something else move between them?",
        )
    offset_m = float(np.linalg.norm(check.offset_m))
    if offset_m > LARGEST_OFFSET_M or abs(check.yaw_rad) > LARGEST_YAW_RAD:
        raise SkillFailure(
            TOO_FAR,
            f"the camera would be off by {1e3 * offset_m:.1f} mm and {np.degrees(check.yaw_rad):.2f} degrees, believed "
            f"are up to {1e3 * LARGEST_OFFSET_M:.0f} mm and {np.degrees(LARGEST_YAW_RAD):.2f} degrees; "
            "calibrate it again",
        )
