"""Conformance checks for people who add an observer, planner, segmentation, camera or arm, also in another package."""

from dlokit.errors import CheckFailed
from dlokit.testing.arms import ArmReport, check_arm
from dlokit.testing.cameras import CameraCheckReport, check_camera, checked_camera
from dlokit.testing.observers import ObserverReport, check_observer
from dlokit.testing.planners import PlannerReport, check_planner
from dlokit.testing.segmentations import SegmentationReport, check_segmentation

__all__ = [
    "ArmReport",
    "CameraCheckReport",
    "CheckFailed",
    "ObserverReport",
    "PlannerReport",
    "SegmentationReport",
    "check_arm",
    "check_camera",
    "check_observer",
    "check_planner",
    "check_segmentation",
    "checked_camera",
]
