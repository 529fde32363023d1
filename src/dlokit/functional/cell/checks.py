"""What the arm's control box refuses, before anything moves."""

import numpy as np

from dlokit.description.panda_data import PANDA_GRIP_FORCE_N, PANDA_OPEN_WIDTH_M
from dlokit.errors import SkillRejected
from dlokit.functional.cell.setpoints import Setpoint
from dlokit.motion.limits import BAD_TRAJECTORY, limit_violation
from dlokit.types.robot import JointLimits, JointTrajectory

START_RAD = 0.02
"""A motion may start this far from what was last commanded [rad]."""
MARGIN = 1.02
"""Limits are kept to this factor: samples of a trajectory at its limits are rounded."""


def check_trajectory(trajectory: JointTrajectory, now: Setpoint, limits: JointLimits) -> None:
    """Raise `SkillRejected` on a trajectory that is malformed, starts elsewhere, or breaks a limit."""
    broken = limit_violation(trajectory, limits, MARGIN)
    if broken is not None:
        reason = broken.reason if broken.reason == BAD_TRAJECTORY else "outside_limits"
        raise SkillRejected(reason, broken.detail)
    off_rad = float(np.abs(trajectory.q_rad[0] - now.q_rad).max())
    if off_rad > START_RAD:
        raise SkillRejected(
            "wrong_start", f"it starts {off_rad:.3f} rad from where the arm is; plan from the present state"
        )


def check_grip(width_m: float, force_n: float) -> None:
    """Raise `SkillRejected` on what the hand cannot do."""
    if not 0.0 <= width_m <= PANDA_OPEN_WIDTH_M:
        raise SkillRejected("bad_width", f"{width_m} m; the fingers open between 0 and {PANDA_OPEN_WIDTH_M} m")
    if not 0.0 < force_n <= PANDA_GRIP_FORCE_N:
        raise SkillRejected("bad_force", f"{force_n} N; the hand presses with up to {PANDA_GRIP_FORCE_N} N")
