"""Perception's skills."""

from dlokit.communication.skill import Condition, Skill
from dlokit.types.arrays import Float64Array
from dlokit.types.fixtures import FixtureCheck
from dlokit.types.image import CameraCheck
from dlokit.types.observation import LookResult
from dlokit.types.robot import FIRST_ROBOT
from dlokit.types.system import StrategySpec

CAMERA_LOST, CLOCK_JUMPED, WRONG_STAMP = "camera_lost", "clock_jumped", "wrong_stamp"
MAY_RETURN = (CAMERA_LOST, CLOCK_JUMPED, WRONG_STAMP)
"""Failures of a camera that may give good pictures again: it returns, or its clock has been learned again."""
TOO_MUCH_SEGMENTED = "too_much_segmented"


def _look() -> LookResult:
    """Take the camera's pictures, find the DLO's points, publish both; returns the stamp and the number of points.

    Fails with: camera_lost (no pictures in time), clock_jumped (the camera's stamps jumped against the host's clock;
    the next pictures are stamped right again), wrong_stamp (the stamp of the pictures is outside the time in which they
    were taken, or the states of a robot are stamped by another clock), too_much_segmented (the segmentation covers a
    larger part of the picture than a DLO can), no_points (no points are left after segmentation and filters). After
    the last two failures, perception still publishes an observation without points.
    """
    ...


def _set_box(lower_world: Float64Array, upper_world: Float64Array) -> None:
    """Look only into the box from `lower_world` (3,) to `upper_world` (3,) [m], from the next look on.

    Rejected with: bad_box.
    """
    ...


def _set_segmentation(spec: StrategySpec) -> None:
    """Segment by another strategy, or by other settings, from the next look on; perception publishes the change.

    Rejected with: unknown_strategy (not installed), bad_settings (unknown, or out of range), dlo_held (a gripper holds
    the DLO: the observer would lose it in the fingers if the new settings do not find it).
    """
    ...


def _set_tracking(rate_hz: float) -> None:
    """Look `rate_hz` times a second from now on; 0 stops it. A look that is due during another is skipped.

    Rejected with: bad_rate.
    """
    ...


def _note_background() -> None:
    """Begin to check the camera's pose: take the pictures with which the pictures of the hand will be compared.

    The arms must not be over the table. Fails with: camera_lost.
    """
    ...


def _see_hand(robot: str = FIRST_ROBOT) -> None:
    """Take pictures of the hand of `robot` at its present pose, above the table and in the picture.

    Call it at two places or more, with the hand turned by half a turn between them, so that errors of its model
    cancel. Fails with: camera_lost, robot_lost (no state of the robot since the pictures).
    """
    ...


def _check_camera() -> CameraCheck:
    """Compute the camera's pose error from the pictures of the hand, and correct the pose from the next look on.

    The table's plane gives height and tilt; the hand, whose pose is exactly known, gives the offset along the table and
    the turn about the vertical. Fails with: few_points (too little of the arm's outline was found), scattered (the
    pictures contradict each other), too_far (an implausible error); only the correction by the table then applies.
    Rejected with: no_pictures.
    """
    ...


def _check_fixtures() -> FixtureCheck:
    """Take pictures, and compare what stands on the table, in the box, with the believed fixtures.

    Fails with: camera_lost, clock_jumped, wrong_stamp (as look), robot_lost (no state of a robot since the pictures).
    """
    ...


LOOK = Skill("perception", "look", _look, timeout_s=10.0, ensures="a new observation is published")
SET_BOX = Skill("perception", "set_box", _set_box, timeout_s=1.0, requires="lower below upper in each coordinate")
SET_SEGMENTATION = Skill(
    "perception",
    "set_segmentation",
    _set_segmentation,
    timeout_s=1.0,
    requires="the strategy is installed, and no gripper holds the DLO",
)
SET_TRACKING = Skill(
    "perception",
    "set_tracking",
    _set_tracking,
    timeout_s=1.0,
    requires=(Condition("rate_hz is 0 (off) to 60 Hz", "bad_rate", lambda rate_hz: 0.0 <= rate_hz <= 60.0),),
)
NOTE_BACKGROUND = Skill(
    "perception", "note_background", _note_background, timeout_s=10.0, requires="no arm stands over the table"
)
SEE_HAND = Skill(
    "perception", "see_hand", _see_hand, timeout_s=10.0, requires="the arm stands still, its hand in the picture"
)
CHECK_CAMERA = Skill(
    "perception",
    "check_camera",
    _check_camera,
    timeout_s=20.0,
    requires="the hand has been seen, and before it the table without it",
    ensures="later looks use the corrected pose",
)
CHECK_FIXTURES = Skill("perception", "check_fixtures", _check_fixtures, timeout_s=20.0, requires="the arms stand still")
