"""Checks the joint limits of a trajectory by divided differences of its angles. Pure.

A robot runs the cubic Hermite pieces through the samples' angles and velocities. The check therefore does not rely on
the stated velocities and accelerations alone; it also compares divided differences of the angles with the limits.

A divided difference of n + 1 nodes, some of which may coincide, times n!, is a value that the n-th derivative takes
between them (de Boor, "Divided differences", Surveys in Approximation Theory 1, 2005). If a motion always keeps the
limits, so do these differences, at any sampling rate, with a tolerance for rounding only. Two values are taken from
the pieces instead: their speed, which must keep the limit (planned motions stay 2 % below it), and their acceleration,
with an allowance for the effect of sampling.
"""

from dataclasses import dataclass

import numpy as np

from dlokit.errors import SkillFailure
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, JointTrajectory, RobotReason

SHORTEST_STEP_S = 1e-4
"""Smallest time between two samples [s]: below it, rounding of the angles shows in their third differences."""
LONGEST_S = 200.0
"""Longest trajectory [s] at its executed pace: no skill waits for a longer one."""
LARGEST_STEP_RAD = 0.1
"""Largest turn of a joint between two samples [rad]: collisions and the tool's pose are checked at samples only. A
joint at its velocity limit turns by 0.013 rad in the 5 ms between planned samples."""
_PLANNED_REST_RAD_S = 1e-3
"""A planned joint slower than this is at rest [rad/s]; planned trajectories end below 1e-13."""
AT_REST_RAD_S = 0.02
"""An arm whose joints are measured slower than this is at rest [rad/s]: the cell's arm at rest measures 0.01, and a
swinging DLO in the gripper moves the joints by less."""
START_RAD = 0.02
"""Largest distance of a trajectory's start from the measured joint angles [rad]. It starts at the commanded end of the
last one, from which a loaded arm sags. The distance adds to the arm's lag, which the Franka's driver bounds."""
_ROUNDING = 1e-6
"""Rounding in sums of thousands of steps stays below this fraction of any limit."""
_SMALLEST = 1e-9
"""Absolute tolerance for limits of zero, which also replaces them as a divisor."""


_ORDER = {
    RobotReason.VELOCITY_LIMIT: 1,
    RobotReason.ACCELERATION_LIMIT: 2,
    RobotReason.JERK_LIMIT: 3,
    RobotReason.BAD_TRAJECTORY: 3,
}
"""Exponent with which the values of each limit grow with the pace."""


@dataclass(frozen=True)
class _Bound:
    """Values (n, J) along the padded trajectory, and their largest allowed magnitude, (J,) or (n, J)."""

    values: Float64Array
    allowed: Float64Array
    reason: RobotReason
    what: str


def check_limits(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Check form, rest at both ends, duration, range, velocity, acceleration and jerk of a trajectory.

    Raises `SkillFailure` for the first violation: bad_trajectory, too_slow, joint_limit, velocity_limit,
    acceleration_limit or jerk_limit; the message states the violation, the limit and what to do.
    """
    wrong = malformed(trajectory, len(limits.velocity_rad_s))
    if wrong:
        raise SkillFailure(RobotReason.BAD_TRAJECTORY, f"{wrong}; plan it again")
    times = trajectory.times_s
    if times[-1] > LONGEST_S:
        raise SkillFailure(
            RobotReason.TOO_SLOW,
            f"it takes {times[-1]:.4g} s, allowed are {LONGEST_S:.0f} s; move faster or less far, or use a larger "
            "--speed-scale",
        )
    lowest, highest = executed_range(trajectory)
    outside = np.maximum(limits.position_lower_rad - lowest, highest - limits.position_upper_rad).clip(min=0.0)
    found = _largest(outside, np.zeros(1))
    if found is not None:
        sample, joint, value = found
        lower, upper = limits.position_lower_rad[joint], limits.position_upper_rad[joint]
        raise SkillFailure(
            RobotReason.JOINT_LIMIT,
            f"joint {joint + 1} leaves its range of {lower:.4f} to {upper:.4f} rad by {value:.4g} rad at "
            f"{times[sample]:.3f} s; choose another target",
        )
    for bound in _bounds(_at_rest_around(trajectory), limits):
        found = _largest(bound.values, bound.allowed)
        if found is not None:
            sample, joint, value = found
            allowed = np.broadcast_to(bound.allowed, bound.values.shape)[sample, joint]
            time_s = times[min(max(sample - 1, 0), len(times) - 1)]  # one sample was put before the first
            raise SkillFailure(
                bound.reason,
                f"{bound.what.format(joint=joint + 1)} at {time_s:.3f} s: {value:.4g}, allowed are {allowed:.4g}; "
                "move slower or choose another target",
            )
    step_rad = float(np.abs(np.diff(trajectory.q_rad, axis=0)).max())
    if step_rad > LARGEST_STEP_RAD:
        raise SkillFailure(
            RobotReason.BAD_TRAJECTORY,
            f"a joint turns by {step_rad:.3g} rad between two samples, allowed are {LARGEST_STEP_RAD}; give more "
            "samples",
        )


def slowdown(trajectory: JointTrajectory, limits: JointLimits) -> float:
    """The factor by which a well-formed trajectory must be slower to keep the limits; at most 1 if it keeps them."""
    return max(
        float(np.max(np.abs(bound.values) / np.maximum(bound.allowed, _SMALLEST))) ** (1.0 / _ORDER[bound.reason])
        for bound in _bounds(_at_rest_around(trajectory), limits)
    )


def speed_ratio(trajectory: JointTrajectory, limits: JointLimits) -> float:
    """Largest ratio of a joint's speed to its limit, which may depend on its angle; 1 is at the limit."""
    return max(
        float(np.max(np.abs(speeds) / np.maximum(allowed, _SMALLEST)))
        for speeds, allowed in executed_speeds(_at_rest_around(trajectory), limits)
    )


def scaled(trajectory: JointTrajectory, pace: float) -> JointTrajectory:
    """The same path at `pace` times the speed; at 1 the same trajectory."""
    if pace == 1.0:
        return trajectory
    return JointTrajectory(
        times_s=trajectory.times_s / pace,
        q_rad=trajectory.q_rad,
        dq_rad_s=trajectory.dq_rad_s * pace,
        ddq_rad_s2=trajectory.ddq_rad_s2 * pace**2,
    )


def executed_range(trajectory: JointTrajectory) -> tuple[Float64Array, Float64Array]:
    """Smallest and largest angle on each cubic Hermite piece, two arrays (K - 1, J) [rad]."""
    h = np.diff(trajectory.times_s)[:, None]
    q0, q1 = trajectory.q_rad[:-1], trajectory.q_rad[1:]
    a, b, c = _velocity_polynomial(trajectory)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Roots of a u² + b u + c without cancellation; a missing root, or one outside the piece, becomes an end.
        half = -0.5 * (b + np.copysign(np.sqrt(b * b - 4.0 * a * c), b))
        turns = [np.nan_to_num(root, nan=0.0, posinf=0.0, neginf=0.0).clip(0.0, 1.0) for root in (half / a, c / half)]
    reached = [q0, q1, *(q0 + h * u * (c + u * (b / 2 + u * a / 3)) for u in turns)]
    return np.minimum.reduce(reached), np.maximum.reduce(reached)


def executed_speeds(trajectory: JointTrajectory, limits: JointLimits) -> list[tuple[Float64Array, Float64Array]]:
    """Pairs of the Hermite pieces' largest speeds (K - 1, J) and their limits; one per direction if the limits differ.

    If the limits depend on the angle, the angle of a piece that is nearest to the end of the range counts.
    """
    a, b, c = _velocity_polynomial(trajectory)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.nan_to_num(-b / (2.0 * a), nan=0.0, posinf=0.0, neginf=0.0).clip(0.0, 1.0)
    reached = [c, a + b + c, c + vertex * (b + vertex * a)]
    down, up = np.minimum.reduce(reached), np.maximum.reduce(reached)
    if limits.slow_near is None:
        return [(np.maximum(np.abs(down), np.abs(up)), limits.velocity_rad_s)]
    lowest, highest = executed_range(trajectory)
    return [
        (np.maximum(up, 0.0), limits.velocity_at(highest, np.ones(highest.shape))),
        (np.minimum(down, 0.0), limits.velocity_at(lowest, -np.ones(lowest.shape))),
    ]


def _velocity_polynomial(trajectory: JointTrajectory) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Coefficients (K - 1, J) of the velocity a u² + b u + c [rad/s] on each piece, u from 0 to 1."""
    slope = np.diff(trajectory.q_rad, axis=0) / np.diff(trajectory.times_s)[:, None]
    v0, v1 = trajectory.dq_rad_s[:-1], trajectory.dq_rad_s[1:]
    return 3.0 * (v0 + v1 - 2.0 * slope), 6.0 * slope - 4.0 * v0 - 2.0 * v1, v0


def malformed(trajectory: JointTrajectory, joints: int) -> str:
    """The fault in the form of a trajectory for an arm with this number of joints; empty if there is none."""
    times, dq = trajectory.times_s, trajectory.dq_rad_s
    if trajectory.q_rad.shape[1] != joints:
        return f"it has {trajectory.q_rad.shape[1]} joints, the arm has {joints}"
    named = ("times_s", "q_rad", "dq_rad_s", "ddq_rad_s2")
    broken = [name for name in named if not np.isfinite(getattr(trajectory, name)).all()]
    if broken:
        return f"{', '.join(broken)} must be finite"
    if len(times) < 2 or times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
        return "times must rise from 0 over at least two samples"
    step_s = float(np.diff(times).min())
    if step_s < SHORTEST_STEP_S:
        return f"two samples are {step_s:.3g} s apart, allowed are at least {SHORTEST_STEP_S} s"
    moving = float(np.abs(dq[[0, -1]]).max())
    if moving > _PLANNED_REST_RAD_S:
        return f"it starts or ends moving at {moving:.3g} rad/s; its first and last velocity must be 0"
    return ""


def _at_rest_around(trajectory: JointTrajectory) -> JointTrajectory:
    """The trajectory with a sample at rest before it and one after it, so that a jump at an end shows."""
    t, q = trajectory.times_s, trajectory.q_rad
    zero = np.zeros((1, q.shape[1]))
    return JointTrajectory(
        times_s=np.concatenate(([t[0] - (t[1] - t[0])], t, [t[-1] + (t[-1] - t[-2])])),
        q_rad=np.concatenate((q[:1], q, q[-1:])),
        dq_rad_s=np.concatenate((zero, trajectory.dq_rad_s, zero)),
        ddq_rad_s2=np.concatenate((zero, trajectory.ddq_rad_s2, zero)),
    )


def _bounds(padded: JointTrajectory, limits: JointLimits) -> list[_Bound]:
    """All values to compare with the limits: the trajectory's stated values first, then its differences."""
    acceleration, jerk = limits.acceleration_rad_s2, limits.jerk_rad_s3
    t, q, dq, ddq = padded.times_s, padded.q_rad, padded.dq_rad_s, padded.ddq_rad_s2
    h = np.diff(t)[:, None]
    slope, change, piece_jerk = np.diff(q, axis=0) / h, np.diff(dq, axis=0) / h, _velocity_polynomial(padded)[0]
    second = 2.0 * np.diff(slope, axis=0) / (t[2:] - t[:-2])[:, None]  # nodes t0, t1, t2
    first_end, last_end = 2.0 * (slope - dq[:-1]) / h, 2.0 * (dq[1:] - slope) / h  # t0, t0, t1 and t0, t1, t1
    ends = np.maximum(np.abs(change - piece_jerk / h), np.abs(change + piece_jerk / h))
    # The second derivative of a Hermite piece at its end is an integral of the true one with the kernel 4 - 6 u, whose
    # magnitude integrates to 5/3, and differs from the true one there by an integral of the jerk, at most 8/27 of it.
    between = np.minimum(5.0 / 3.0 * acceleration, acceleration + 8.0 / 27.0 * jerk * h)
    third = 3.0 * np.diff(second, axis=0) / (t[3:] - t[:-3])[:, None]  # t0, t1, t2, t3
    # The last row: the trapezoidal rule errs by at most a quarter of the largest slope of its integrand, here the jerk.
    joint = "joint {joint}"
    return [
        _Bound(dq, limits.velocity_at(q, dq), RobotReason.VELOCITY_LIMIT, f"velocity [rad/s] of {joint}"),
        _Bound(ddq, acceleration, RobotReason.ACCELERATION_LIMIT, f"acceleration [rad/s²] of {joint}"),
        _Bound(np.diff(ddq, axis=0) / h, jerk, RobotReason.JERK_LIMIT, f"jerk [rad/s³] of {joint}"),
        *(
            _Bound(peak, allowed, RobotReason.VELOCITY_LIMIT, f"velocity [rad/s] run by {joint}")
            for peak, allowed in executed_speeds(padded, limits)
        ),
        _Bound(change, acceleration, RobotReason.ACCELERATION_LIMIT, f"change of velocity [rad/s²] of {joint}"),
        *(
            _Bound(
                values, acceleration, RobotReason.ACCELERATION_LIMIT, f"acceleration [rad/s²] by the angles of {joint}"
            )
            for values in (second, first_end, last_end)
        ),
        _Bound(ends, between, RobotReason.ACCELERATION_LIMIT, f"acceleration [rad/s²] between samples of {joint}"),
        *(
            _Bound(values, jerk, RobotReason.JERK_LIMIT, f"jerk [rad/s³] by the angles and velocities of {joint}")
            for values in (2.0 * piece_jerk / h**2, 2.0 * np.diff(change, axis=0) / (t[2:] - t[:-2])[:, None], third)
        ),
        _Bound(
            (ddq[1:] + ddq[:-1]) / 2 - change,
            jerk * h / 4,
            RobotReason.BAD_TRAJECTORY,
            f"ddq less the change of dq of {joint}",
        ),
    ]


def _largest(values: Float64Array, allowed: Float64Array) -> tuple[int, int, float] | None:
    """Row, column and magnitude of the value that exceeds its limit by most; None if no value exceeds it."""
    excess = np.abs(values) - allowed * (1.0 + _ROUNDING) - _SMALLEST
    if not np.any(excess > 0.0):
        return None
    row, column = np.unravel_index(int(np.argmax(excess)), excess.shape)
    return int(row), int(column), float(abs(values[row, column]))
