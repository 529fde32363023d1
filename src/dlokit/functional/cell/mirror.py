"""Joint set-points of a mirrored arm: an arm of the cell follows the states of another arm, of a twin run."""

import numpy as np

from dlokit.functional.cell.setpoints import Setpoint
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

_KEPT = 128
"""States that are kept: those of a second, longer than the cell falls behind while it renders."""
_AHEAD_S = 0.05
"""Longest time for which the newest state is extended by its velocities [s]: six periods of the states. Without newer
states the arm then stands still."""


class Mirror:
    """A `Program` that repeats what another arm reports, by the stamps of its states."""

    end_s = np.inf

    def __init__(self, q_rad: Float64Array, start_ns: int) -> None:
        """`q_rad` (J,) are the angles before the first state, `start_ns` the cell's stamp at its time 0."""
        self.start_ns = start_ns
        self._before = Setpoint(q_rad.copy(), np.zeros(q_rad.shape), np.zeros(q_rad.shape))
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
        if not states:
            return self._before
        newest = states[-1]
        if stamp_ns >= newest.stamp_ns:
            since_s = (stamp_ns - newest.stamp_ns) / 1e9
            moves = since_s < _AHEAD_S
            q_rad = newest.q_rad + min(since_s, _AHEAD_S) * newest.dq_rad_s
            return _setpoint(q_rad, newest.dq_rad_s if moves else np.zeros(len(q_rad)))
        after = newest
        for before in reversed(states[:-1]):
            if before.stamp_ns <= stamp_ns:
                u = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
                return _setpoint(
                    (1.0 - u) * before.q_rad + u * after.q_rad, (1.0 - u) * before.dq_rad_s + u * after.dq_rad_s
                )
            after = before
        return _setpoint(after.q_rad, after.dq_rad_s)


def _setpoint(q_rad: Float64Array, dq_rad_s: Float64Array) -> Setpoint:
    return Setpoint(q_rad, dq_rad_s, np.zeros(len(q_rad)))
