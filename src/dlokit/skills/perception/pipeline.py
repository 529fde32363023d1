"""From pictures to the DLO's points in the world: every step of perception, in order.

Stereo pairs are matched, depth images contain their depths: only the step `_surface` differs. Pure: the same
arguments give the same result. The intermediate results are kept for reports and examples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_TOP_M
from dlokit.errors import SkillFailure
from dlokit.skills.perception.api import TOO_MUCH_SEGMENTED
from dlokit.skills.perception.base import Segmentation, SegmentationConfig
from dlokit.skills.perception.calibration import arm_outline
from dlokit.skills.perception.calibration.table import camera_pose_from_table
from dlokit.skills.perception.cloud import clean, inside_box, to_centre_line
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.depth import surface_of_depth
from dlokit.skills.perception.fixture_filter import behind_fixtures, with_fixtures
from dlokit.skills.perception.rectification import grey, rectified
from dlokit.skills.perception.self_filter import (
    OCCLUSION_SCALE,
    PICTURE_MARGIN_M,
    SPACE_MARGIN_M,
    Capsules,
    PosedArm,
    box_outline,
    occlusion_map,
    robot_capsules,
    robot_distance_m,
    robot_outline,
)
from dlokit.skills.perception.stereo import StereoMatcher, reproject, window_around
from dlokit.types.arrays import BoolArray, Float64Array, UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, Image, SegmentedPicture, StereoImages
from dlokit.types.observation import GripperPin, Observation
from dlokit.types.pose import Pose

LARGEST_SHARE = 0.5
"""Largest fraction of the possible part of the picture that a DLO covers: strands that can be distinguished have gaps
as wide as themselves. A hose of 1 m and 40 mm, straight across a picture, covers 0.08 of it."""
SMALL_SHARE = 0.1
"""A smaller fraction of the whole picture is never too much: the box may be close around the DLO."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """Result of one look, and the pixels from which it was computed."""

    observation: Observation
    mask: BoolArray  # (height, width) segmented pixels that may be in the box and are not the robot's


def loaded() -> None:
    """Compile the kernels of a look; importing this module has loaded all libraries that it needs."""
    arm_outline.load_kernels()


def perceive(
    images: CameraPictures,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
    dlo_radius_m: float,
    pins: tuple[GripperPin, ...] = (),
    fixtures: Sequence[Fixture] = (),
) -> Look:
    """Compute the observation of `images`, with the robots at known states, among fixtures at believed poses.

    The camera sees the DLO's surface; `dlo_radius_m` moves the cloud from there to its centre line. Raises
    `SkillFailure` ``too_much_segmented``, before anything that takes time.
    """
    ideal = rectified(images)
    camera = ideal.calibration
    strategy = segmentation.build()
    capsules = robot_capsules(robots)
    possible = _possible(camera, capsules, config)
    mask = cleaned(segmented(ideal.reference, strategy) & possible, config.smallest_patch_px)
    check_share(mask, possible, segmentation.name)
    surface = _surface(ideal, mask, strategy, config)
    keep = inside_box(surface, config.box)
    keep[keep] = robot_distance_m(surface[keep], capsules) > SPACE_MARGIN_M
    keep[keep] = ~behind_fixtures(surface[keep], fixtures, camera)
    floor_m = TABLE_TOP_M if config.table.supports else None
    points = clean(to_centre_line(surface[keep], camera, dlo_radius_m, floor_m), config.cloud.voxel_m)
    return Look(
        observation=Observation(
            stamp_ns=images.stamp_ns,
            points_world=points.astype(np.float32),
            calibration=camera,
            occlusion=with_fixtures(occlusion_map(capsules, camera, OCCLUSION_SCALE), fixtures, camera),
            pins=pins,
        ),
        mask=mask,
    )


def observe(
    images: CameraPictures,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
    dlo_radius_m: float,
    pins: tuple[GripperPin, ...] = (),
    fixtures: Sequence[Fixture] = (),
) -> Observation:
    """The observation of `perceive`, without its intermediate results; small enough to return from another process."""
    return perceive(images, robots, config, segmentation, dlo_radius_m, pins, fixtures).observation


def segmentation_preview(
    images: CameraPictures,
    robots: Sequence[PosedArm],
    segmentation: SegmentationConfig,
    config: PerceptionConfig,
    width_px: int,
) -> SegmentedPicture:
    """Show which pixels of a picture a look with `segmentation` would use: the first half of `perceive`.

    The result is at most `width_px` wide. Whatever another package's segmentation raises is its `problem`.
    """
    ideal = rectified(images)
    picture, camera = ideal.reference, ideal.calibration
    nothing = np.zeros(picture.shape[:2], dtype=np.bool_)
    taken, used, problem = nothing, nothing, ""
    try:
        taken = segmented(picture, segmentation.build())
        possible = _possible(camera, robot_capsules(robots), config)
        used = cleaned(taken & possible, config.smallest_patch_px)
        check_share(used, possible, segmentation.name)
        if not used.any():
            problem = "No pixel is DLO: click on the DLO in the picture, or widen the ranges."
    except SkillFailure as failure:
        problem = failure.detail
    except Exception as error:  # it is the user's own code, whose error the user must see
        problem = f"The segmentation {segmentation.name} fails: {type(error).__name__}: {error}"
    return SegmentedPicture(
        pixels=_smaller(picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2), width_px),
        used=_smaller(used.astype(np.uint8) * np.uint8(255), width_px),
        dropped=_smaller((taken & ~used).astype(np.uint8) * np.uint8(255), width_px),
        fraction=float(used.mean()),
        problem=problem,
    )


def _smaller(picture: UInt8Array, width_px: int) -> UInt8Array:
    """The picture (h, w) or (h, w, 3), at most `width_px` wide, with its proportions."""
    height, width = picture.shape[:2]
    if width <= width_px:
        return picture
    size = (width_px, max(1, round(height * width_px / width)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _possible(camera: CameraCalibration, capsules: Capsules, config: PerceptionConfig) -> BoolArray:
    """The pixels (height, width) in which the DLO may be seen: in the box, and beside the robots."""
    return box_outline(config.box, camera) & ~robot_outline(capsules, camera, PICTURE_MARGIN_M)


def without_points(images: CameraPictures) -> Observation:
    """The observation of pictures in which no DLO is seen."""
    points = np.zeros((0, 3), dtype=np.float32)
    return Observation(stamp_ns=images.stamp_ns, points_world=points, calibration=images.calibration)


def corrected_camera_pose(
    images: CameraPictures,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
) -> Pose | None:
    """T_world_camera of `images`, corrected by the table's plane; None when it cannot be."""
    ideal = rectified(images)
    capsules = robot_capsules(robots)
    robot = robot_outline(capsules, ideal.calibration, PICTURE_MARGIN_M)
    hidden = robot | segmented(ideal.reference, segmentation.build())
    return camera_pose_from_table(ideal, hidden, config.box)


def _surface(images: CameraPictures, mask: BoolArray, strategy: Segmentation, config: PerceptionConfig) -> Float64Array:
    """Surface points (N, 3) [m] of the masked pixels (height, width): matched, or measured by the camera."""
    if not isinstance(images, StereoImages):
        return surface_of_depth(images, mask)
    camera = images.calibration
    disparity = StereoMatcher(config.stereo).match(
        grey(images.left), grey(images.right), mask, segmented(images.right, strategy), camera
    )
    return np.zeros((0, 3)) if disparity is None else reproject(disparity, camera)


def segmented(picture: UInt8Array, strategy: Segmentation) -> BoolArray:
    """The pixels (height, width) of a picture that a strategy takes for DLO."""
    return strategy.mask(Image(stamp_ns=0, pixels=picture)).pixels


def check_share(mask: BoolArray, possible: BoolArray, segmentation: str) -> None:
    """Raise `SkillFailure` when the mask covers a larger fraction of the possible pixels than a DLO can."""
    taken_px, possible_px = np.count_nonzero(mask), np.count_nonzero(possible)
    if taken_px > max(LARGEST_SHARE * possible_px, SMALL_SHARE * mask.size):
        raise SkillFailure(
            TOO_MUCH_SEGMENTED,
            f"the segmentation {segmentation} takes {taken_px / possible_px:.0%} of the picture (in the box, beside "
            f"the robot) for DLO; a DLO takes {LARGEST_SHARE:.0%} at most, and usually some percent: change its "
            f"settings or choose another one (`--segmentation {segmentation} --help` shows them)",
        )


def cleaned(mask: BoolArray, smallest_px: int) -> BoolArray:
    """The mask without its small patches."""
    window = window_around(mask, margin_px=0)
    if window is None:
        return mask
    part = mask[window.top : window.bottom, window.left : window.right]
    _, labels, stats, _ = cv2.connectedComponentsWithStats(part.astype(np.uint8), connectivity=8)
    large = np.asarray(stats)[:, cv2.CC_STAT_AREA] >= smallest_px
    large[0] = False  # the surroundings
    result = np.zeros_like(mask)
    result[window.top : window.bottom, window.left : window.right] = large[np.asarray(labels, dtype=np.int32)]
    return result
