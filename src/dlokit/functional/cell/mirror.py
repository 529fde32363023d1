"""Joint set-points of a mirrored arm: an arm of the cell follows the states of another arm, of a twin run."""

import numpy as np

from dlokit.functional.cell.setpoints import Setpoint
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

_KEPT = 128
"""States that are kept: those of a second, longer than the cell falls behind while it renders."""
_SPAN = 3
"""States over which a velocity is taken: two periods, so that their jitter matters less."""
_AHEAD_S = 0.05
"""Longest time for which the newest state is extended by the velocity [s]: six periods of the states. Without newer
states the arm then stands still."""


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
        """Mean velocities (J,) by the stamps: those that an arm reports are by its own clock.

        A simulator on a busy machine needs up to twice the time for a motion.
        """
        first, last = states[0], states[-1]
        return (last.q_rad - first.q_rad) / ((last.stamp_ns - first.stamp_ns) / 1e9)
