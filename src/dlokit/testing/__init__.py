"""Conformance checks for people who add an observer, planner, segmentation, camera, arm or robot, also elsewhere."""

from dlokit.errors import CheckFailed
from dlokit.testing.arms import ArmReport, check_arm
from dlokit.testing.cameras import CameraCheckReport, check_camera, checked_camera
from dlokit.testing.observers import ObserverReport, check_observer
from dlokit.testing.planners import PlannerReport, check_planner
from dlokit.testing.robots import RobotCheckReport, check_robot, checked_robot
from dlokit.testing.segmentations import SegmentationReport, check_segmentation

__all__ = [
    "ArmReport",
    "CameraCheckReport",
    "CheckFailed",
    "ObserverReport",
    "PlannerReport",
    "RobotCheckReport",
    "SegmentationReport",
    "check_arm",
    "check_camera",
    "check_observer",
    "check_planner",
    "check_robot",
    "check_segmentation",
    "checked_camera",
    "checked_robot",
]
