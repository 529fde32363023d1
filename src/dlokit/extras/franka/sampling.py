"""Interpolates a sampled trajectory to set-points at the arm's time, and brakes on the path. Pure, NumPy only.

The set-points are ``q(s)`` and ``q'(s) r``, where s is the time along the trajectory and r = ds/dt its rate: 1 while
the motion runs. Braking lowers r, so that the arm stays on the path that was checked.
"""

import numpy as np

from dlokit.types.arrays import Float64Array

_FADE_USED = 0.05
"""Fraction of the joints' limits with which an offset at the start decays."""
_SHORTEST_BRAKE_S = 0.05
"""Shortest braking time [s], also for a slow motion that could stop at once."""
_RAMP_S = 0.02
"""Time in which the deceleration rises to its largest [s]."""
_STILL_RATE = 1e-3
"""Below this rate a braked motion is at rest: a joint moves slower than 0.006 rad/s."""
_LONGEST_STEP_S = 1e-3
"""Longest step of the integration of braking [s], the arm's own cycle."""
_SMALLEST_RAD_S = 1e-6
TRIM_RAD = 0.005
"""Largest correction of a set-point [rad]: 3 N·m at the strong joints, which is within their friction."""
_TRIM_S = 0.3
"""Time constant of the correction [s], ten times the time constant of the joints' control."""


class Trim:
    """A slow correction of set-points, up to `TRIM_RAD`, by which the arm reaches them.

    Impedance control yields to errors of the arm's model of gravity and friction: by 1.4 mm downward at a grasp
    in franky-sim, where fingertips pass 2 mm above the table. The correction outlasts a motion: the next motion
    begins with the last correction.
    """

    def __init__(self) -> None:
        self.rad: Float64Array = np.zeros(7)

    def learn(self, off: Float64Array, step_s: float) -> None:
        """Update with set-point minus measured angle (7,) [rad], over a time on the arm's clock."""
        self.rad = np.clip(self.rad + off * (step_s / _TRIM_S), -TRIM_RAD, TRIM_RAD)


class Course:
    """A running trajectory. Angles (7,) [rad], speeds (7,) [rad/s]; times in seconds of the arm's clock."""

    def __init__(
        self,
        times: Float64Array,
        q: Float64Array,
        dq: Float64Array,
        start_q: Float64Array,
        velocity: Float64Array,
        acceleration: Float64Array,
        jerk: Float64Array,
    ) -> None:
        """`times` (K,), `q` and `dq` (K, 7), K ≥ 2; `start_q` are the arm's present angles; limits (7,).

        An offset of `start_q` from the first sample fades out, by a minimum-jerk profile.
        """
        self._times, self._q, self._dq = times, q, dq
        self._acceleration, self._jerk = acceleration, jerk
        self._offset = start_q - q[0]
        size = np.abs(self._offset)
        # Largest speed, acceleration and jerk of a minimum-jerk profile of one unit in one second.
        fade_s = (
            1.875 * size / (_FADE_USED * velocity),
            np.sqrt(5.774 * size / (_FADE_USED * acceleration)),
            np.cbrt(60.0 * size / (_FADE_USED * jerk)),
        )
        self._fade_s = max(float(np.max(fade_s)), 1e-9)
        self._last_s = float(times[-1])
        self._end_s = max(self._last_s, self._fade_s)
        self._piece = 0
        self._s = 0.0
        self._rate, self._slowing = 1.0, 0.0
        self.braking = False
        """Whether `brake` was called."""

    @property
    def path_s(self) -> float:
        """Time along the trajectory [s]."""
        return self._s

    @property
    def finished(self) -> bool:
        """Whether the set-points are at rest, at the end or braked before it."""
        return self._rate == 0.0 or self._s >= self._end_s

    def brake(self) -> None:
        """Brake on the path, from now on."""
        self.braking = True

    def advance(self, step_s: float) -> None:
        """Advance the arm's time."""
        if not self.braking:
            self._s = min(self._s + step_s, self._end_s)
            return
        steps = max(1, int(np.ceil(step_s / _LONGEST_STEP_S - 1e-9)))
        for _ in range(steps):
            if not self.finished:
                self._slow_down(step_s / steps)

    def setpoint(self, ahead_s: float = 0.0) -> tuple[Float64Array, Float64Array]:
        """Angles and speeds, `ahead_s` later than now."""
        q, first, _ = self._at(min(self._s + ahead_s * self._rate, self._end_s))
        return q, first * self._rate

    def _slow_down(self, step_s: float) -> None:
        """One step of braking: the strongest deceleration of the rate within all joints' limits.

        A joint's acceleration is ``q'' r² + q' dr/dt``, and its jerk contains ``q' d²r/dt²``.
        """
        _, first, second = self._at(self._s)
        speed = np.maximum(np.abs(first), _SMALLEST_RAD_S)
        # The path's own acceleration changes within a cycle by the jerk limit: the worse of both ends counts.
        _, _, later = self._at(min(self._s + self._rate * step_s, self._end_s))
        asked = np.minimum(np.sign(first) * second, np.sign(first) * later) * self._rate**2
        room = self._acceleration + asked
        strongest = min(float(np.min(np.maximum(room, 0.0) / speed)), 1.0 / _SHORTEST_BRAKE_S)
        change = min(0.5 * float(np.min(self._jerk / speed)), 1.0 / (_SHORTEST_BRAKE_S * _RAMP_S))
        # At the end the deceleration falls to zero together with the rate.
        wanted = min(strongest, float(np.sqrt(2.0 * change * self._rate)))
        # It falls at once: where the path itself begins to slow down, a joint's acceleration stays at its limit.
        self._slowing = min(wanted, self._slowing + change * step_s)
        rate = max(self._rate - self._slowing * step_s, 0.0)
        self._s = min(self._s + 0.5 * (self._rate + rate) * step_s, self._end_s)
        self._rate = 0.0 if rate < _STILL_RATE else rate

    def _at(self, s: float) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Angles and their first and second derivative by s: cubic Hermite pieces, and the offset that remains."""
        q, first, second = self._hermite(s)
        if s < self._fade_s:
            u = s / self._fade_s
            q = q + (1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)) * self._offset
            first = first - (30.0 * u**2 * (1.0 - u) ** 2 / self._fade_s) * self._offset
            second = second - (60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / self._fade_s**2) * self._offset
        return q, first, second

    def _hermite(self, s: float) -> tuple[Float64Array, Float64Array, Float64Array]:
        times = self._times
        if s >= self._last_s:
            still = np.zeros(len(self._offset))
            return self._q[-1], still, still
        i = self._piece
        while s < times[i]:
            i -= 1
        while s >= times[i + 1]:
            i += 1
        self._piece = i
        h = times[i + 1] - times[i]
        u = (s - times[i]) / h
        q0, v0, v1 = self._q[i], self._dq[i], self._dq[i + 1]
        slope = (self._q[i + 1] - q0) / h
        a, b = v0 + v1 - 2.0 * slope, 3.0 * slope - 2.0 * v0 - v1
        q = q0 + h * u * (v0 + u * (b + u * a))
        return q, v0 + u * (2.0 * b + 3.0 * u * a), (2.0 * b + 6.0 * u * a) / h
