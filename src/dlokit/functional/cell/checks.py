"""What the arm's control box refuses, before anything moves."""

import numpy as np

from dlokit.description.panda_data import PANDA_GRIP_FORCE_N, PANDA_OPEN_WIDTH_M
from dlokit.errors import SkillRejected
from dlokit.functional.cell.setpoints import Servo, Setpoint
from dlokit.motion.limits import BAD_TRAJECTORY, limit_violation
from dlokit.types.arrays import Float64Array
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


def check_servo(q_rad: Float64Array, dq_rad_s: Float64Array, now: Setpoint, limits: JointLimits) -> None:
    """Raise `SkillRejected` on a servo target that is malformed, breaks a limit, or is too far to be reached."""
    shape = now.q_rad.shape
    if q_rad.shape != shape or dq_rad_s.shape != shape or not np.isfinite([q_rad, dq_rad_s]).all():
        raise SkillRejected("outside_limits", f"angles and velocities must be finite and {shape}")
    _check_limits(q_rad[None], dq_rad_s[None], limits)
    jump = np.abs(q_rad - now.q_rad) - limits.velocity_rad_s * Servo.KEEP_S
    if jump.max() > 0.0:
        joint = int(jump.argmax())
        raise SkillRejected("outside_limits", f"joint {joint + 1} cannot jump to {q_rad[joint]:.3f} rad")


def check_grip(width_m: float, force_n: float) -> None:
    """Raise `SkillRejected` on what the hand cannot do."""
    if not 0.0 <= width_m <= PANDA_OPEN_WIDTH_M:
        raise SkillRejected("bad_width", f"{width_m} m; the fingers open between 0 and {PANDA_OPEN_WIDTH_M} m")
    if not 0.0 < force_n <= PANDA_GRIP_FORCE_N:
        raise SkillRejected("bad_force", f"{force_n} N; the hand presses with up to {PANDA_GRIP_FORCE_N} N")


def _check_limits(q_rad: Float64Array, dq_rad_s: Float64Array, limits: JointLimits) -> None:
    beyond = np.maximum(limits.position_lower_rad - q_rad, q_rad - limits.position_upper_rad)  # (K, J)
    if beyond.max() > 1e-6:
        joint = int(beyond.max(axis=0).argmax())
        lower, upper = limits.position_lower_rad[joint], limits.position_upper_rad[joint]
        raise SkillRejected("outside_limits", f"joint {joint + 1} leaves {lower:.3f} to {upper:.3f} rad")
    _check_at_most(dq_rad_s, limits.velocity_rad_s, "velocity", "rad/s")


def _check_at_most(values: Float64Array, most: Float64Array, what: str, unit: str) -> None:
    used = np.abs(values).max(axis=0) / most  # (J,)
    if used.max() > MARGIN:
        joint = int(used.argmax())
        raise SkillRejected(
            "outside_limits",
            f"{what} of joint {joint + 1} reaches {used[joint] * most[joint]:.3f}, allowed {most[joint]:.3f} {unit}",
        )
