"""Set-points of the arm over time: hold, follow a trajectory, brake, mirror another arm."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import ruckig

from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointLimits, JointTrajectory, RobotState


@dataclass(frozen=True)
class Setpoint:
    """Commanded angles, velocities and accelerations of the joints."""

    q_rad: Float64Array  # (J,)
    dq_rad_s: Float64Array  # (J,)
    ddq_rad_s2: Float64Array  # (J,)


class Program(Protocol):
    """A motion of the joints in time."""

    end_s: float
    """Its end on the cell's clock [s]."""

    def at(self, time_s: float) -> Setpoint:
        """The set-point at a time on the cell's clock."""
        ...


class HoldStill:
    """Hold the joints at their angles."""

    def __init__(self, q_rad: Float64Array) -> None:
        self.end_s = -np.inf
        self._setpoint = Setpoint(q_rad.copy(), np.zeros(q_rad.shape), np.zeros(q_rad.shape))

    def at(self, time_s: float) -> Setpoint:
        """The constant set-point."""
        return self._setpoint


class Follow:
    """Sample a trajectory: cubic Hermite in position, so that position and velocity agree between samples.

    Where the commanded angles differ a little from the first sample, as after a brake, that offset fades out.
    """

    def __init__(self, trajectory: JointTrajectory, start_s: float, fade: "Fade | None" = None) -> None:
        self._trajectory = trajectory
        self._start_s = start_s
        self._fade = fade
        self.end_s = start_s + max(float(trajectory.times_s[-1]), 0.0 if fade is None else fade.duration_s)

    def at(self, time_s: float) -> Setpoint:
        """The set-point, held at both ends."""
        t = self._trajectory
        if len(t.times_s) == 1:
            return Setpoint(t.q_rad[0], t.dq_rad_s[0], t.ddq_rad_s2[0])
        s = min(max(time_s - self._start_s, 0.0), float(t.times_s[-1]))
        i = min(max(int(np.searchsorted(t.times_s, s, side="right")) - 1, 0), len(t.times_s) - 2)
        h = float(t.times_s[i + 1] - t.times_s[i])
        u = (s - float(t.times_s[i])) / h
        q0, q1, v0, v1 = t.q_rad[i], t.q_rad[i + 1], t.dq_rad_s[i], t.dq_rad_s[i + 1]
        step = q1 - q0
        q = q0 + u * (h * v0 + u * (3 * step - h * (2 * v0 + v1) + u * (h * (v0 + v1) - 2 * step)))
        point = Setpoint(q, (1 - u) * v0 + u * v1, (1 - u) * t.ddq_rad_s2[i] + u * t.ddq_rad_s2[i + 1])
        return point if self._fade is None else self._fade.added(point, time_s - self._start_s)


class Fade:
    """An offset of the joints that decays to zero by a minimum-jerk profile, with a hundredth of their limits."""

    _USED = 0.01

    def __init__(self, offset_rad: Float64Array, limits: JointLimits) -> None:
        """`offset_rad` (7,) is the commanded angles minus the first angles of the next motion."""
        size = np.abs(offset_rad)
        # Largest speed, acceleration and jerk of a minimum-jerk profile of one unit in one second.
        seconds = (
            1.875 * size / (self._USED * limits.velocity_rad_s),
            np.sqrt(5.774 * size / (self._USED * limits.acceleration_rad_s2)),
            np.cbrt(60.0 * size / (self._USED * limits.jerk_rad_s3)),
        )
        self._offset_rad = offset_rad
        self.duration_s = float(np.max(seconds))

    def added(self, point: Setpoint, passed_s: float) -> Setpoint:
        """The set-point plus the offset that remains after a time."""
        T = self.duration_s
        u = min(max(passed_s / T, 0.0), 1.0)
        left = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        rate, gain = -30.0 * u**2 * (1.0 - u) ** 2 / T, -60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / T**2
        return Setpoint(
            point.q_rad + left * self._offset_rad,
            point.dq_rad_s + rate * self._offset_rad,
            point.ddq_rad_s2 + gain * self._offset_rad,
        )


class Brake:
    """Come to rest as fast as acceleration and jerk limits allow, each joint on its own."""

    def __init__(self, start: Setpoint, limits: JointLimits, now_s: float) -> None:
        joints = len(start.q_rad)
        wanted: Any = ruckig.InputParameter(joints)
        wanted.control_interface = ruckig.ControlInterface.Velocity
        wanted.synchronization = ruckig.Synchronization.No
        wanted.current_position = start.q_rad
        wanted.current_velocity = np.clip(start.dq_rad_s, -limits.velocity_rad_s, limits.velocity_rad_s)
        # Slightly within the limits: on the limit itself, rounding makes the problem infeasible.
        most = 0.999 * limits.acceleration_rad_s2
        wanted.current_acceleration = np.clip(start.ddq_rad_s2, -most, most)
        wanted.target_velocity = np.zeros(joints)
        wanted.target_acceleration = np.zeros(joints)
        wanted.max_acceleration = limits.acceleration_rad_s2
        wanted.max_jerk = limits.jerk_rad_s3
        self._path: Any = ruckig.Trajectory(joints)
        ruckig.Ruckig(joints).calculate(wanted, self._path)
        self._start_s = now_s
        self.end_s = now_s + float(self._path.duration)

    def at(self, time_s: float) -> Setpoint:
        """The set-point, at rest after the end."""
        s = min(max(time_s - self._start_s, 0.0), float(self._path.duration))
        q, dq, ddq = self._path.at_time(s)
        return Setpoint(np.array(q), np.array(dq), np.array(ddq))


_KEPT = 128
"""Number of states that are kept, for one second: the cell falls behind by less while it renders."""
_SPAN = 3
"""States over which a velocity is taken: two periods, so that their jitter matters less."""
_AHEAD_S = 0.05
"""Longest time for which the newest state is extrapolated by the velocity [s]: six periods of the states. Without
newer states the arm then stops."""


class Mirror:
    """A `Program` that repeats what another arm reports, by the stamps of its states."""

    end_s = np.inf

    def __init__(self, q_rad: Float64Array, start_ns: int) -> None:
        """`q_rad` (J,) are the angles before the first state, `start_ns` the cell's stamp at its time 0."""
        self.start_ns = start_ns
        self._rest_rad_s = np.zeros(q_rad.shape)
        self._before = Setpoint(q_rad.copy(), self._rest_rad_s, self._rest_rad_s)
        self._states: tuple[RobotState, ...] = ()

    @property
    def first_q_rad(self) -> Float64Array | None:
        """Angles (J,) of the oldest state that is kept; None before the first state."""
        return self._states[0].q_rad if self._states else None

    def receive(self, state: RobotState) -> None:
        """Take over a state; from any one thread, while another reads."""
        if not self._states or state.stamp_ns > self._states[-1].stamp_ns:
            self._states = (*self._states[-_KEPT + 1 :], state)

    def at(self, time_s: float) -> Setpoint:
        """Angles and velocities between two states, or shortly after the newest."""
        states, stamp_ns = self._states, self.start_ns + round(time_s * 1e9)
        if len(states) < _SPAN:
            return Setpoint(states[-1].q_rad, self._rest_rad_s, self._rest_rad_s) if states else self._before
        last = len(states) - 1
        while last >= _SPAN and states[last - 1].stamp_ns > stamp_ns:
            last -= 1
        newer, older = states[last], states[last - 1]
        if stamp_ns <= newer.stamp_ns:
            part = max((stamp_ns - older.stamp_ns) / (newer.stamp_ns - older.stamp_ns), 0.0)
            q_rad = older.q_rad + part * (newer.q_rad - older.q_rad)
            return Setpoint(q_rad, self._velocity(states[last - _SPAN + 1 : last + 1]), self._rest_rad_s)
        since_s = (stamp_ns - newer.stamp_ns) / 1e9
        dq_rad_s = self._velocity(states[last - _SPAN + 1 :])
        q_rad = newer.q_rad + min(since_s, _AHEAD_S) * dq_rad_s
        return Setpoint(q_rad, dq_rad_s if since_s < _AHEAD_S else self._rest_rad_s, self._rest_rad_s)

    @staticmethod
    def _velocity(states: tuple[RobotState, ...]) -> Float64Array:
        """Mean velocities (J,) by the stamps, because the velocities that an arm reports use its own clock.

        A simulator on a busy machine needs up to twice the time for a motion.
        """
        first, last = states[0], states[-1]
        return (last.q_rad - first.q_rad) / ((last.stamp_ns - first.stamp_ns) / 1e9)
