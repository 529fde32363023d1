"""Trajectories: joint space by ruckig, tool paths by a speed limit along the path. Pure.

Both start and end at rest and keep the joint limits of position, velocity, acceleration and jerk.
"""

import numpy as np
import ruckig
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from dlokit.errors import SkillFailure
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.limits import scaled, slowdown
from dlokit.motion.tool_path import ToolPath, split_at_turns
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointLimits, JointTrajectory, RobotReason

SAMPLE_S = 0.005
"""Time between samples [s]."""
LONGEST_S = 120.0
"""Longest duration of a tool path [s], the longest time-out of a skill; its samples take 5 MB."""
LONGEST_M = 15.0
"""Longest tool path [m], a minute at the default speed; planning it takes 0.5 s."""
LONGEST_TILTED_M = 3.0
"""Longest tool path with a gripper that does not point straight down [m]: its inverse kinematics is iterative and takes
0.15 s per metre."""
MOST_STOPS = 100
"""Largest number of stops of a tool path, at which it reverses; each takes 5 ms to plan."""
_PATH_STEP_M = 0.005
_LARGEST_STEP_RAD = 0.5  # between path samples; more is a jump to another posture
# Fractions of a joint's acceleration for the curvature of the path and for the acceleration along it.
_BEND_FRACTION, _SPEEDUP_FRACTION = 0.6, 0.4
_MARGIN = 0.98  # of each limit, for what happens between samples
_SLOWEST_RAD_S = 1e-9  # a joint at the end of its range may have no speed at all, and none is divided by it


def joint_move(start_q_rad: ArrayLike, end_q_rad: ArrayLike, limits: JointLimits) -> JointTrajectory:
    """The fastest straight line in joint space between two configurations (J,) [rad], at rest at both.

    Raises `SkillFailure` ``joint_limit`` if the end is outside the limits.
    """
    start, end = np.asarray(start_q_rad, dtype=np.float64), np.asarray(end_q_rad, dtype=np.float64)
    outside = np.flatnonzero((end < limits.position_lower_rad) | (end > limits.position_upper_rad))
    if len(outside):
        joint = int(outside[0])
        raise SkillFailure(
            RobotReason.JOINT_LIMIT,
            f"joint {joint + 1} cannot go to {end[joint]:.3f} rad; allowed are {limits.position_lower_rad[joint]:.3f} "
            f"to {limits.position_upper_rad[joint]:.3f} rad",
        )
    if np.max(np.abs(end - start)) < 1e-6:
        return _standing(end)
    request = ruckig.InputParameter(len(start))
    request.current_position, request.target_position = start.tolist(), end.tolist()
    request.max_velocity = (_MARGIN * limits.velocity_rad_s).tolist()
    request.max_acceleration = (_MARGIN * limits.acceleration_rad_s2).tolist()
    request.max_jerk = (_MARGIN * limits.jerk_rad_s3).tolist()
    request.synchronization = ruckig.Synchronization.Phase
    motion = ruckig.Trajectory(len(start))
    ruckig.Ruckig(len(start)).calculate(request, motion)
    times = np.linspace(0.0, motion.duration, int(np.ceil(motion.duration / SAMPLE_S)) + 1)
    samples = np.array([motion.at_time(float(t)) for t in times])  # (K, 3, J)
    move = JointTrajectory(times_s=times, q_rad=samples[:, 0], dq_rad_s=samples[:, 1], ddq_rad_s2=samples[:, 2])
    if limits.slow_near is None:
        return move
    late = slowdown(move, limits)
    return move if late <= 1.0 else scaled(move, _MARGIN / late)


def pose_move(kinematics: ArmKinematics, start_q_rad: ArrayLike, T_world_tcp: Pose, yaw: Yaw) -> JointTrajectory:
    """The fastest straight line in joint space from `start_q_rad` (J,) [rad] to a tool pose.

    Raises `SkillFailure` ``unreachable`` and ``joint_limit``.
    """
    return joint_move(start_q_rad, kinematics.inverse(T_world_tcp, start_q_rad, yaw), kinematics.arm.limits)


def tool_move(
    kinematics: ArmKinematics,
    start_q_rad: ArrayLike,
    poses: tuple[Pose, ...],
    velocity: VelocityProfile,
) -> JointTrajectory:
    """Straight lines of the tool through `poses`, rounded where two meet, from its pose at `start_q_rad` (J,).

    All poses may be turned by half a turn, if that is nearer at the first pose. The tool is slower than `velocity`
    where joint limits require it. Raises `SkillFailure` ``unreachable`` and ``too_slow``.
    """
    q = np.asarray(start_q_rad, dtype=np.float64)
    pieces: list[JointTrajectory] = []
    for pose in poses:
        kinematics.check_length(pose)
    paths = split_at_turns(kinematics.forward(q), poses)
    _check_effort(paths, velocity)
    for path in paths:
        piece = _timed(_follow(kinematics, path, q), path, velocity, kinematics.arm.limits)
        pieces.append(piece)
        q = piece.q_rad[-1]
    if not pieces:
        return _standing(q)
    return pieces[0] if len(pieces) == 1 else joined(pieces)


def _check_effort(paths: list[ToolPath], velocity: VelocityProfile) -> None:
    """Refuse at once a path that would take minutes to plan: it could not run within a skill's time-out."""
    lengths = np.array([path.length_m for path in paths])
    # Lower bounds on the time from rest to rest, each from one of the profile's values alone.
    least = np.maximum.reduce(
        [
            lengths / velocity.speed_m_s,
            2.0 * np.sqrt(lengths / velocity.acceleration_m_s2),
            np.cbrt(32.0 * lengths / velocity.jerk_m_s3),
        ]
    )
    # The acceleration rises during the time over which speeds are averaged.
    seconds = max(float(np.sum(least)), velocity.acceleration_m_s2 / velocity.jerk_m_s3)
    tilted_m = sum(path.length_m for path in paths if not path.points_down)
    too_long = np.sum(lengths) > LONGEST_M or tilted_m > LONGEST_TILTED_M
    if seconds > LONGEST_S or too_long or len(paths) > MOST_STOPS:
        raise SkillFailure(
            RobotReason.TOO_SLOW,
            f"a path of {np.sum(lengths):.3g} m, of which {tilted_m:.3g} m tilted, with {len(paths)} stops at "
            f"{velocity.speed_m_s:.3g} m/s, {velocity.acceleration_m_s2:.3g} m/s² and {velocity.jerk_m_s3:.3g} m/s³ "
            f"takes {seconds:.3g} s or more to run or to speed up; allowed are {LONGEST_S:.0f} s, {LONGEST_M:.0f} m, "
            f"{LONGEST_TILTED_M:.0f} m tilted and {MOST_STOPS} stops; choose a faster profile, or split the path",
        )


def _follow(kinematics: ArmKinematics, path: ToolPath, start_q: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Path parameters (n,) [m] and joint angles (n, J) [rad] along a tool path."""
    sigma = np.linspace(0.0, path.length_m, max(8, int(np.ceil(path.length_m / _PATH_STEP_M)) + 1))
    q = [start_q]
    for s in sigma[1:]:
        pose = path.pose(float(s))
        q.append(kinematics.inverse(pose, q[-1], Yaw.EXACT))
        if np.max(np.abs(q[-1] - q[-2])) > _LARGEST_STEP_RAD:  # at once: the rest of the path may take long
            x, y, z = pose.position_m
            raise SkillFailure(
                RobotReason.UNREACHABLE,
                f"the arm cannot pass ({x:.3f}, {y:.3f}, {z:.3f}) m without changing its posture; split the path there",
            )
    return sigma, np.array(q)


def _timed(
    samples: tuple[Float64Array, Float64Array], path: ToolPath, velocity: VelocityProfile, limits: JointLimits
) -> JointTrajectory:
    """A time law for a path: as fast as profile and joints allow, with bounded jerk."""
    sigma, q = samples
    curve = CubicSpline(sigma, q)
    place = CubicSpline(sigma, np.array([path.pose(float(s)).position_m for s in sigma]))
    fine = np.linspace(0.0, sigma[-1], 4 * len(sigma))
    speed = _speed_along(fine, curve, place, velocity, limits)
    # A wider average costs time once, at the end; a narrower one costs time at every dip of the speed.
    laws = (_time_law(fine, speed, curve, velocity, limits, width) for width in (1.0, 2.0))
    return min(laws, key=lambda law: float(law.times_s[-1]))


def _time_law(
    fine: Float64Array,
    speed: Float64Array,
    curve: CubicSpline,
    velocity: VelocityProfile,
    limits: JointLimits,
    width: float,
) -> JointTrajectory:
    """The path at these speeds, smoothed; all of it is slowed down to remove the remaining violations."""
    times, travelled, rate = _smoothed(fine, speed, velocity, width)
    dt = times[1]
    gain = np.gradient(rate, dt)
    first, second = curve(travelled, 1), curve(travelled, 2)
    dq = first * rate[:, None]
    ddq = second * rate[:, None] ** 2 + first * gain[:, None]
    jerk = np.diff(ddq, axis=0) / dt
    # Velocities scale with the factor, accelerations with its square, jerks with its cube.
    joints = max(
        _ratio(dq, limits.velocity_at(curve(travelled), dq)),
        np.sqrt(_ratio(ddq, limits.acceleration_rad_s2)),
        np.cbrt(_ratio(jerk, limits.jerk_rad_s3)),
    )
    tool = np.cbrt(float(np.max(np.abs(np.diff(gain)))) / dt / velocity.jerk_m_s3)
    factor = 1.0 / max(1.0, joints / _MARGIN, tool)
    law = JointTrajectory(
        times_s=times / factor,
        q_rad=curve(travelled),
        dq_rad_s=dq * factor,
        ddq_rad_s2=ddq * factor**2,
    )
    # On short legs with high jerk, the spline's sampled velocities change by more than its accelerations state.
    late = slowdown(law, limits)
    return law if late <= 1.0 else scaled(law, _MARGIN / late)


def _speed_along(
    fine: Float64Array, curve: CubicSpline, place: CubicSpline, velocity: VelocityProfile, limits: JointLimits
) -> Float64Array:
    """Largest speed along the path at each of its parameters `fine`, (n,) [m/s], from rest to rest."""
    first = np.maximum(np.abs(curve(fine, 1)), 1e-6)
    second = np.maximum(np.abs(curve(fine, 2)), 1e-6)
    bend = np.maximum(np.linalg.norm(place(fine, 2), axis=1), 1e-6)
    top = np.minimum.reduce(
        [
            np.full(len(fine), velocity.speed_m_s),
            np.sqrt(velocity.acceleration_m_s2 / bend),
            np.min(_MARGIN * limits.velocity_at(curve(fine), curve(fine, 1)) / first, axis=1),
            np.min(np.sqrt(_BEND_FRACTION * limits.acceleration_rad_s2 / second), axis=1),
        ]
    )
    gain = np.minimum(
        velocity.acceleration_m_s2, np.min(_SPEEDUP_FRACTION * limits.acceleration_rad_s2 / first, axis=1)
    )
    square = top**2
    square[0] = square[-1] = 0.0
    step = fine[1] - fine[0]
    for i in range(1, len(fine)):
        square[i] = min(square[i], square[i - 1] + 2 * gain[i] * step)
    for i in range(len(fine) - 2, -1, -1):
        square[i] = min(square[i], square[i + 1] + 2 * gain[i] * step)
    return np.sqrt(square)


def _smoothed(
    fine: Float64Array, speed: Float64Array, velocity: VelocityProfile, width: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Times (K,) [s], path parameters (K,) [m] and speeds (K,) [m/s], with the jerk bounded by a moving average."""
    arrival = np.concatenate(([0.0], np.cumsum(2 * np.diff(fine) / np.maximum(speed[:-1] + speed[1:], 1e-6))))
    window = max(2, int(np.ceil(width * velocity.acceleration_m_s2 / velocity.jerk_m_s3 / SAMPLE_S)))
    steps = max(2, int(np.ceil(arrival[-1] / SAMPLE_S)))
    dt = arrival[-1] / steps
    rate = np.interp(np.linspace(0.0, arrival[-1], steps + 1), arrival, speed)
    rate = np.convolve(np.pad(rate, (1, 1)), np.full(window, 1.0 / window))
    travelled = np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) * dt / 2)))
    scale = fine[-1] / travelled[-1]
    return np.arange(len(rate)) * dt, np.minimum(travelled * scale, fine[-1]), rate * scale


def _ratio(values: Float64Array, limits: Float64Array) -> float:
    return float(np.max(np.abs(values) / np.maximum(limits, _SLOWEST_RAD_S)))


def _standing(q: Float64Array) -> JointTrajectory:
    zero = np.zeros((2, len(q)))
    return JointTrajectory(
        times_s=np.array([0.0, SAMPLE_S]), q_rad=np.array([q, q]), dq_rad_s=zero, ddq_rad_s2=zero.copy()
    )


def backwards(move: JointTrajectory, limits: JointLimits) -> JointTrajectory:
    """The same path from its end to its start; slower where velocity limits differ by direction."""
    back = JointTrajectory(
        times_s=move.times_s[-1] - move.times_s[::-1],
        q_rad=move.q_rad[::-1],
        dq_rad_s=-move.dq_rad_s[::-1],
        ddq_rad_s2=move.ddq_rad_s2[::-1],
    )
    late = slowdown(back, limits)
    return back if late <= 1.0 else scaled(back, _MARGIN / late)


def joined(pieces: list[JointTrajectory]) -> JointTrajectory:
    """Join pieces in order; each starts at rest, at the previous piece's end."""
    first, rest = pieces[0], pieces[1:]
    begins_s = np.cumsum([piece.times_s[-1] for piece in pieces[:-1]])
    return JointTrajectory(
        times_s=np.concatenate([first.times_s, *(one.times_s[1:] + s for one, s in zip(rest, begins_s, strict=True))]),
        q_rad=np.concatenate([first.q_rad, *(piece.q_rad[1:] for piece in rest)]),
        dq_rad_s=np.concatenate([first.dq_rad_s, *(piece.dq_rad_s[1:] for piece in rest)]),
        ddq_rad_s2=np.concatenate([first.ddq_rad_s2, *(piece.ddq_rad_s2[1:] for piece in rest)]),
    )
