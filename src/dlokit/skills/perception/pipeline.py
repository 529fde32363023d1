"""From a pair of pictures to the DLO's points in the world: every step of perception, in order.

Pure: the same arguments give the same result. The intermediate results are kept for reports and examples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from dlokit.description.table import TABLE_TOP_M
from dlokit.skills.perception.base import Segmentation, SegmentationConfig
from dlokit.skills.perception.calibration import arm_outline
from dlokit.skills.perception.calibration.table import camera_pose_from_table
from dlokit.skills.perception.cloud import clean, inside_box, to_centre_line
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.rectification import grey, rectified
from dlokit.skills.perception.reprojection import box_outline, reproject
from dlokit.skills.perception.self_filter import (
    OCCLUSION_SCALE,
    PICTURE_MARGIN_M,
    SPACE_MARGIN_M,
    Capsules,
    PosedArm,
    occlusion_map,
    robot_capsules,
    robot_distance_m,
    robot_outline,
)
from dlokit.skills.perception.stereo import Disparity, StereoMatcher, window_around
from dlokit.types.arrays import BoolArray, UInt8Array
from dlokit.types.image import CameraCalibration, Image, StereoImages
from dlokit.types.observation import GripperPin, Observation
from dlokit.types.pose import Pose


@dataclass(frozen=True, kw_only=True)
class Look:
    """One look: its result, and what lay between."""

    observation: Observation
    rectified: StereoImages
    segmented: BoolArray  # (height, width) what the segmentation took for DLO
    mask: BoolArray  # (height, width) of that, what may lie in the box and is not the robot
    disparity: Disparity | None
    """Of the mask; None when it is empty."""


def loaded() -> None:
    """Compile what a look needs; where it could be called, all of it has been imported."""
    arm_outline.load_kernels()


def perceive(
    images: StereoImages,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
    dlo_radius_m: float,
    pins: tuple[GripperPin, ...] = (),
) -> Look:
    """Look at `images`, knowing where the robots are.

    The camera sees the DLO's surface; `dlo_radius_m` moves the cloud from there to its centre line.
    """
    pair = rectified(images)
    camera = pair.calibration
    strategy = segmentation.build()
    capsules = robot_capsules(robots)
    segmented = _segmented(pair.left, strategy)
    mask = _cleaned(segmented & _where_dlo_may_be(capsules, camera, config), config.smallest_patch_px)
    disparity = StereoMatcher(config.stereo).match(
        grey(pair.left), grey(pair.right), mask, _segmented(pair.right, strategy), camera
    )
    surface = np.zeros((0, 3)) if disparity is None else reproject(disparity, camera)
    keep = inside_box(surface, config.box)
    keep[keep] = robot_distance_m(surface[keep], capsules) > SPACE_MARGIN_M
    floor_m = TABLE_TOP_M if config.table.supports else None
    points = clean(to_centre_line(surface[keep], camera, dlo_radius_m, floor_m), config.cloud.voxel_m)
    return Look(
        observation=Observation(
            stamp_ns=images.stamp_ns,
            points_world=points.astype(np.float32),
            calibration=camera,
            occlusion=occlusion_map(capsules, camera, OCCLUSION_SCALE),
            pins=pins,
        ),
        rectified=pair,
        segmented=segmented,
        mask=mask,
        disparity=disparity,
    )


def observe(
    images: StereoImages,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
    dlo_radius_m: float,
    pins: tuple[GripperPin, ...] = (),
) -> Observation:
    """The result of `perceive` alone, for when it comes from another process."""
    return perceive(images, robots, config, segmentation, dlo_radius_m, pins).observation


def corrected_camera_pose(
    images: StereoImages,
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
) -> Pose | None:
    """T_world_camera of `images`, corrected by the table's plane; None when it cannot be."""
    pair = rectified(images)
    capsules = robot_capsules(robots)
    robot = robot_outline(capsules, pair.calibration, PICTURE_MARGIN_M)
    hidden = robot | _segmented(pair.left, segmentation.build())
    return camera_pose_from_table(pair, hidden, config.box)


def _segmented(picture: UInt8Array, strategy: Segmentation) -> BoolArray:
    return strategy.mask(Image(stamp_ns=0, pixels=picture)).pixels


def _where_dlo_may_be(capsules: Capsules, camera: CameraCalibration, config: PerceptionConfig) -> BoolArray:
    robot = robot_outline(capsules, camera, PICTURE_MARGIN_M)
    return box_outline(config.box, camera) & ~robot


def _cleaned(mask: BoolArray, smallest_px: int) -> BoolArray:
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
