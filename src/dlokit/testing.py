"""`dlokit.testing`: conformance checks for people who add an observer, planner, segmentation, camera, arm or robot.

`python -m dlokit.testing observer NAME` runs them on a strategy, camera, arm or robot.
"""

import sys

from dlokit.errors import CheckFailed
from dlokit.extras.checks import scenes
from dlokit.extras.checks.arms import ArmReport, check_arm
from dlokit.extras.checks.cameras import CameraCheckReport, check_camera, checked_camera
from dlokit.extras.checks.observers import ObserverReport, check_observer
from dlokit.extras.checks.planners import PlannerReport, check_planner
from dlokit.extras.checks.robots import RobotCheckReport, check_robot
from dlokit.extras.checks.segmentations import SegmentationReport, check_segmentation

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
    "scenes",
]

# Packages from before the annexes import it by this name.
sys.modules["dlokit.testing.scenes"] = scenes

if __name__ == "__main__":
    from dlokit.extras.checks.command import main

    main()
