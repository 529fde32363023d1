"""The cell's skills, which the drivers of the simulated camera and of the simulated robot call.

Only drivers call these skills. They replace the cables to real cameras and a real arm, and do not reveal the DLO's
true shape. Each arm is addressed by its name; while a robot process serves it, only that process may move it or clear
its stop, and another caller is rejected with not_driver. SLIP and LAY are for benches.
"""

from dlokit.communication.skill import Condition, Skill
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.robot import FIRST_ROBOT, GripResult, JointTrajectory, MotionResult

CLOCK_JUMPED = "clock_jumped"


def _capture() -> StereoImages:
    """Expose both cameras now, with the believed calibration.

    Fails with: no_opengl, clock_jumped (the camera's clock; the next pictures are stamped right again).
    """
    ...


def _capture_depth() -> DepthImage:
    """Expose the depth camera now, with the believed calibration.

    Fails with: no_opengl, clock_jumped (the camera's clock; the next pictures are stamped right again).
    """
    ...


def _follow(trajectory: JointTrajectory, lease_s: float, robot: str = FIRST_ROBOT) -> MotionResult:
    """Move the arm along a joint trajectory, from the first of its samples to the last.

    The arm brakes within its limits when the call is cancelled, on BRAKE and STOP, and when no RENEW arrived for
    `lease_s` seconds of the machine's clock; in the last case it is then in fault. Limits are checked where a motion is
    planned and at the gate before the driver, not here.
    Fails with: stopped, lost_commander. Rejected with: no_such_robot, stop_latched, busy, fault, wrong_start,
    bad_trajectory, mirrors (in a twin run the arm follows a driver's arm).
    """
    ...


def _renew(robot: str = FIRST_ROBOT) -> None:
    """Send a heartbeat of the commander of the arm's motion and of its fingers."""
    ...


def _grip(width_m: float, force_n: float, lease_s: float, robot: str = FIRST_ROBOT) -> GripResult:
    """Bring the fingers to a width, pressing with at most `force_n`; returns when they are at rest.

    The fingers stop on STOP, when the call is cancelled, and when no RENEW arrived for `lease_s` seconds of the
    machine's clock. Fails with: stopped, lost_commander. Rejected with: stop_latched, bad_width, bad_force.
    """
    ...


def _slip(width_m: float, for_s: float, force_n: float, robot: str = FIRST_ROBOT) -> None:
    """Open the fingers to a width for `for_s` seconds of the cell's clock and close them, unknown to the arm's driver.

    A fault that benches inject: the DLO slips out of the grasp. No driver calls it.
    Fails and is rejected as GRIP.
    """
    ...


def _lay() -> None:
    """Place the DLO in the cell's start shape, as a person would between two tasks.

    For benches of many tasks; no driver calls it. Returns after the cell's `settle_s`, when the DLO is at rest.
    Rejected with: arm_moves.
    """
    ...


def _brake(robot: str = FIRST_ROBOT) -> None:
    """Brake the arm within its limits; returns when it is at rest. The next motion may begin at once."""
    ...


def _stop(robot: str = FIRST_ROBOT) -> None:
    """Brake the arm, hold its fingers, and refuse motions until ENABLE; returns when the arm is at rest."""
    ...


def _enable(robot: str = FIRST_ROBOT) -> None:
    """Clear a STOP: a person has checked that the arm may move."""
    ...


def _recover(robot: str = FIRST_ROBOT) -> None:
    """Clear a fault; the arm stays where it is, and a STOP stays."""
    ...


DRIVER = Condition("the caller is the process of the robot that drives the arm, if there is one", "not_driver")

CAPTURE = Skill("cell", "capture", _capture, timeout_s=10.0, ensures="both pictures are of the same moment")
CAPTURE_DEPTH = Skill("cell", "capture_depth", _capture_depth, timeout_s=10.0, ensures="each depth is of its pixel")
FOLLOW = Skill(
    "cell",
    "follow",
    _follow,
    timeout_s=240.0,
    requires=(
        DRIVER,
        Condition("no other motion runs, no fault, the trajectory starts at rest where the arm is, keeps its limits"),
    ),
    ensures="the arm is at rest at the last sample",
)
RENEW = Skill("cell", "renew", _renew, timeout_s=1.0, requires=(DRIVER,))
GRIP = Skill("cell", "grip", _grip, timeout_s=10.0, requires=(DRIVER,), ensures="the fingers are at rest")
SLIP = Skill(
    "cell",
    "slip",
    _slip,
    timeout_s=20.0,
    requires=(Condition("for_s is above 0 and at most 5", "bad_arguments", lambda for_s: 0.0 < for_s <= 5.0),),
    ensures="the fingers have opened and closed",
)
LAY = Skill("cell", "lay", _lay, timeout_s=20.0, ensures="the DLO lies in the start shape")
BRAKE = Skill("cell", "brake", _brake, timeout_s=5.0, ensures="the arm is at rest")
STOP = Skill("cell", "stop", _stop, timeout_s=5.0, ensures="arm and fingers are at rest, and nothing moves them")
ENABLE = Skill("cell", "enable", _enable, timeout_s=5.0, requires=(DRIVER,), ensures="the arm may be moved")
RECOVER = Skill("cell", "recover", _recover, timeout_s=5.0, requires=(DRIVER,), ensures="the arm is idle")
