"""Thins the states of arms at rest, so that an hour of waiting for an operator does not fill the disk."""

from dataclasses import dataclass

import numpy as np

from dlokit.types.robot import RobotState

REST_BEGINS_S = 1.0
"""An arm is at rest once it has not moved for this long [s of the run's clock]; until then every state is recorded, so
that a replayed component sees how the arm settled."""
REST_STATES_PER_S = 10.0
"""Rate of the recorded states of an arm at rest [1/s]; a reader never finds a gap that looks like a lost arm."""
_STILL_RAD = 1e-4
"""Largest joint movement of an arm at rest [rad]: above the noise of encoders, below 0.1 mm at the tool."""
_STILL_RAD_S = 1e-3
"""Largest joint velocity of an arm at rest [rad/s]."""
_STILL_M = 1e-5
"""Largest movement of resting fingers [m]."""


@dataclass
class _Rest:
    """An arm that has not moved since `begin_ns` [ns of the run's clock]."""

    state: RobotState
    begin_ns: int
    kept_ns: int


class RestThinning:
    """Selects the states of arms that are recorded."""

    def __init__(self) -> None:
        self._rests: dict[str, _Rest] = {}

    def keeps(self, channel: str, log_ns: int, state: RobotState) -> bool:
        """Whether the state that arrived on `channel` at `log_ns` is recorded."""
        rest = self._rests.get(channel)
        if rest is None or not _still(rest.state, state) or log_ns < rest.kept_ns:
            self._rests[channel] = _Rest(state, log_ns, log_ns)
            return True
        if log_ns - rest.begin_ns >= 1e9 * REST_BEGINS_S and log_ns - rest.kept_ns < 1e9 / REST_STATES_PER_S:
            return False
        rest.kept_ns = log_ns
        return True


def _still(before: RobotState, now: RobotState) -> bool:
    return (
        (before.mode, before.holding, before.stop_latched) == (now.mode, now.holding, now.stop_latched)
        and abs(now.finger_width_m - before.finger_width_m) <= _STILL_M
        and bool(np.all(np.abs(now.q_rad - before.q_rad) <= _STILL_RAD))
        and bool(np.all(np.abs(now.dq_rad_s) <= _STILL_RAD_S))
    )
