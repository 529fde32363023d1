"""The cell's socket: what the simulated camera and the simulated robot ask of it.

Drivers alone call these skills. They are what cables to a real camera and a real arm are; the DLO's true shape
is not among them. Each arm is called by its name.
"""

from dlokit.communication.skill import Skill
from dlokit.types.image import StereoImages
from dlokit.types.robot import FIRST_ROBOT, GripResult, JointTrajectory, MotionResult


def _capture() -> StereoImages:
    """Expose both cameras now, with the calibration that the cell's owner believes in.

    Fails with: no_opengl.
    """
    ...


def _follow(trajectory: JointTrajectory, lease_s: float, robot: str = FIRST_ROBOT) -> MotionResult:
    """Move the arm along a joint trajectory, from the first of its samples to the last.

    The arm brakes within its limits when the call is cancelled, on BRAKE and STOP, and when no RENEW came for `lease_s`
    seconds of the machine's clock; after the last it is in fault.
    Fails with: stopped, lost_commander. Rejected with: no_such_robot, stop_latched, busy, fault, wrong_start,
    outside_limits, bad_trajectory.
    """
    ...


def _renew(robot: str = FIRST_ROBOT) -> None:
    """Say that the commander of the arm's motion, or of its fingers', is still there."""
    ...


def _grip(width_m: float, force_n: float, lease_s: float, robot: str = FIRST_ROBOT) -> GripResult:
    """Bring the fingers to a width, pressing with at most `force_n` on what is between them; waits until they rest.

    They stay where they are on STOP, when the call is cancelled, and when no RENEW came for `lease_s` seconds of the
    machine's clock. Fails with: stopped, lost_commander. Rejected with: stop_latched, bad_width, bad_force.
    """
    ...


def _brake(robot: str = FIRST_ROBOT) -> None:
    """Brake the arm within its limits; returns when it stands. The next motion may begin at once."""
    ...


def _stop(robot: str = FIRST_ROBOT) -> None:
    """Brake the arm, hold its fingers, and refuse whatever moves until ENABLE; returns when the arm stands."""
    ...


def _enable(robot: str = FIRST_ROBOT) -> None:
    """Clear a STOP: a person has seen to it that the arm may move."""
    ...


def _recover(robot: str = FIRST_ROBOT) -> None:
    """Clear a fault; the arm stays where it is, and a STOP stays."""
    ...


CAPTURE = Skill("cell", "capture", _capture, timeout_s=10.0, ensures="both pictures are of the same moment")
FOLLOW = Skill(
    "cell",
    "follow",
    _follow,
    timeout_s=240.0,
    requires="no other motion runs, no fault, the trajectory starts at rest where the arm is and keeps its limits",
    ensures="the arm stands at the last sample",
)
RENEW = Skill("cell", "renew", _renew, timeout_s=1.0)
GRIP = Skill("cell", "grip", _grip, timeout_s=10.0, ensures="the fingers are at rest")
BRAKE = Skill("cell", "brake", _brake, timeout_s=5.0, ensures="the arm stands")
STOP = Skill("cell", "stop", _stop, timeout_s=5.0, ensures="arm and fingers stand, and nothing moves them")
ENABLE = Skill("cell", "enable", _enable, timeout_s=5.0, ensures="the arm may be moved")
RECOVER = Skill("cell", "recover", _recover, timeout_s=5.0, ensures="the arm is idle")
