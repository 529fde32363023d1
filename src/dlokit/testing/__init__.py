"""Conformance checks for people who add an observer, a planner or a segmentation, in dlokit or in a package."""

from dlokit.errors import CheckFailed
from dlokit.testing.observers import ObserverReport, check_observer
from dlokit.testing.planners import PlannerReport, check_planner
from dlokit.testing.segmentations import SegmentationReport, check_segmentation

__all__ = [
    "CheckFailed",
    "ObserverReport",
    "PlannerReport",
    "SegmentationReport",
    "check_observer",
    "check_planner",
    "check_segmentation",
]
