"""What the arm's control box refuses, before anything moves."""

import numpy as np

from dlokit.errors import SkillRejected
from dlokit.functional.cell.setpoints import Servo, Setpoint
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, JointTrajectory

START_RAD = 0.02
"""A motion may start this far from what was last commanded [rad]."""
REST_RAD_S = 0.02
"""Slower than this counts as standing [rad/s]."""
MARGIN = 1.02
"""Limits are kept to this factor: samples of a trajectory at its limits are rounded."""
GRIP_WIDTH_M = 0.08
GRIP_FORCE_N = 70.0


def check_trajectory(trajectory: JointTrajectory, now: Setpoint, limits: JointLimits) -> None:
    """Raise `SkillRejected` on a trajectory that is malformed, starts elsewhere, or breaks a limit."""
    times, joints = trajectory.times_s, len(now.q_rad)
    arrays = (trajectory.q_rad, trajectory.dq_rad_s, trajectory.ddq_rad_s2)
    if times.ndim != 1 or len(times) < 2 or any(array.shape != (len(times), joints) for array in arrays):
        raise SkillRejected(
            "bad_trajectory",
            f"times {times.shape} and samples {[array.shape for array in arrays]}; (K,) and (K, {joints}), K >= 2",
        )
    if not all(np.isfinite(array).all() for array in (times, *arrays)):
        raise SkillRejected("bad_trajectory", "it holds values that are not finite")
    if times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
        raise SkillRejected("bad_trajectory", "times must rise from 0")
    off_rad = float(np.abs(trajectory.q_rad[0] - now.q_rad).max())
    if off_rad > START_RAD or np.abs(trajectory.dq_rad_s[0]).max() > REST_RAD_S:
        raise SkillRejected(
            "wrong_start", f"it starts {off_rad:.3f} rad from where the arm is, or moving; plan from the present state"
        )
    if np.abs(trajectory.dq_rad_s[-1]).max() > REST_RAD_S:
        raise SkillRejected("bad_trajectory", "it ends moving; its last velocity must be 0")
    _check_limits(trajectory.q_rad, trajectory.dq_rad_s, limits)
    _check_at_most(trajectory.ddq_rad_s2, limits.acceleration_rad_s2, "acceleration", "rad/s²")


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
    if not 0.0 <= width_m <= GRIP_WIDTH_M:
        raise SkillRejected("bad_width", f"{width_m} m; the fingers open between 0 and {GRIP_WIDTH_M} m")
    if not 0.0 < force_n <= GRIP_FORCE_N:
        raise SkillRejected("bad_force", f"{force_n} N; the hand presses with up to {GRIP_FORCE_N} N")


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
