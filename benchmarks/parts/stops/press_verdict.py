"""What became of the arm after a person's stop, judged by its feedback and by what its commander tried."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit.skills.robot import api as robot
from dlokit.types.robot import RobotState
from parts.stops.attempts import Attempt

STANDS_RAD = 0.02
"""Of any joint [rad]: what a held arm and the DLO's pull move it by."""
FINGERS_STAND_M = 0.0005
REFUSED = f"Rejected {robot.ENABLED.reason}"
TRIED = (robot.MOVE_JOINTS.key, robot.GRASP.key, robot.RECOVER.key)
"""Each of these must have been tried, and refused, before a stop counts as one that holds."""
NOT_SENT = "Unreachable"
"""A commander that was frozen for long has lost the bus for a moment: such an attempt reached no arm."""


@dataclass(frozen=True, kw_only=True)
class Press:
    """One stop."""

    confirmed_s: float | None
    """From the order until feedback had confirmed that the arm stands and is stopped [s]; None: it never did."""
    moved_rad: float = 0.0
    """Largest movement of a joint after the confirmation [rad]."""
    fingers_m: float = 0.0
    """Largest change of the fingers' width after the confirmation [m]."""
    wrong: tuple[str, ...] = ()
    """What was not as it should be; empty: nothing."""


@dataclass(frozen=True, kw_only=True)
class StopReport:
    """A person's stop, as its command reported it."""

    confirmed_s: float | None
    """From the order, or from the start of the robot's process, until the confirmation [s]; None: it never came."""
    exit_code: int
    from_s: float = 0.0
    """When the arm must stand, by the machine's monotonic clock [s]."""
    said: str = ""
    """The lines that it printed."""


def judged(
    report: StopReport,
    states: Sequence[RobotState],
    attempts: Sequence[Attempt],
    *,
    exit_code: int,
    holds: bool,
    goes_on: bool,
) -> Press:
    """Judge one stop by what was seen from the confirmation on, before a person enabled the arm.

    `states` begin with the one at the confirmation. `exit_code` is the right one; `holds` says that the fingers must go
    on holding the DLO, `goes_on` whether the arm moved again after a person had enabled it.
    """
    q_rad = np.array([state.q_rad for state in states])
    width_m = np.array([state.finger_width_m for state in states])
    moved_rad = float(np.abs(q_rad - q_rad[0]).max())
    fingers_m = float(np.abs(width_m - width_m[0]).max())
    checks = (
        (report.confirmed_s is not None, f"the stop was not confirmed: {report.said}"),
        (report.exit_code == exit_code, f"exit code {report.exit_code} of dlokit stop, which should be {exit_code}"),
        (moved_rad <= STANDS_RAD, f"a joint moved by {moved_rad:.3f} rad"),
        (fingers_m <= FINGERS_STAND_M, f"the fingers moved by {fingers_m * 1e3:.2f} mm"),
        (all(state.stop_latched for state in states[1:]), "the stop was not latched all the time"),
        (not holds or all(state.holding for state in states), "the fingers let the DLO go"),
        (goes_on, "the arm did not move again after dlokit enable"),
    )
    wrong = [text for is_right, text in checks if not is_right]
    accepted = {
        f"{one.skill} was not refused: {one.ended_as}" for one in attempts if one.ended_as not in (REFUSED, NOT_SENT)
    }
    wrong += [*sorted(accepted), *(f"{key} was not tried" for key in not_tried(attempts))]
    return Press(confirmed_s=report.confirmed_s, moved_rad=moved_rad, fingers_m=fingers_m, wrong=tuple(wrong))


def not_tried(attempts: Sequence[Attempt]) -> list[str]:
    """Each of `TRIED` that the arm has not answered."""
    answered = {one.skill for one in attempts if one.ended_as != NOT_SENT}
    return [key for key in TRIED if key not in answered]
