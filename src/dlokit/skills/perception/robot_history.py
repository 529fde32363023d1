"""Estimates each robot's state at the exposure of a picture, by interpolation between its states.

States arrive every 20 ms; in this time, a tool at 0.3 m/s travels 6 mm.
"""

from collections import deque

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

KEPT_S = 2.0
"""States older than this are forgotten [s]; a picture is processed much sooner."""
RESTING_RAD_S = 1e-3
"""Joint speed below which an arm counts as at rest: in a whole exchange of messages it moves by less than 0.1 mm."""
FRESH_S = 0.05
"""Age up to which the state of an arm at rest is valid for a picture [s]: an arm that starts moves by 1 mm in it."""


class RobotHistory:
    """The recent states of all robots."""

    def __init__(self) -> None:
        self._states: dict[str, deque[RobotState]] = {}

    def add(self, state: RobotState) -> None:
        """Note a state. One that is not newer than the last one replaces it: the robot's clock was set back."""
        states = self._states.setdefault(state.robot, deque())
        while states and states[-1].stamp_ns >= state.stamp_ns:
            states.pop()
        states.append(state)
        while states[0].stamp_ns < state.stamp_ns - round(KEPT_S * 1e9):
            states.popleft()

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots whose states have arrived."""
        return tuple(self._states)

    def newest(self, robot: str) -> RobotState | None:
        """The last state; None before the first."""
        states = self._states.get(robot)
        return states[-1] if states else None

    def off_ns(self, robot: str, stamp_ns: int) -> int:
        """Time by which the nearest kept state is later (positive) or earlier than a time [ns]; 0 within the states."""
        states = self._states[robot]
        return max(states[0].stamp_ns - stamp_ns, 0) + min(states[-1].stamp_ns - stamp_ns, 0)

    def at(self, robot: str, stamp_ns: int) -> RobotState | None:
        """The state at a time, interpolated; None if it is not known yet.

        The last state of an arm at rest is valid for a while. Before the first kept state, that state is returned.
        """
        states = self._states.get(robot)
        if not states:
            return None
        newest = states[-1]
        if newest.stamp_ns < stamp_ns:
            rests = np.abs(newest.dq_rad_s).max(initial=0.0) < RESTING_RAD_S
            return newest if rests and stamp_ns - newest.stamp_ns < round(FRESH_S * 1e9) else None
        after = newest
        for before in reversed(states):
            if before.stamp_ns <= stamp_ns:
                return between(before, after, stamp_ns)
            after = before
        return after


def between(before: RobotState, after: RobotState, stamp_ns: int) -> RobotState:
    """The state at a time between two states; values that are not numbers come from the nearer state."""
    if stamp_ns in (before.stamp_ns, after.stamp_ns):
        return before if stamp_ns == before.stamp_ns else after
    fraction = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)

    def mixed(earlier: Float64Array, later: Float64Array) -> Float64Array:
        return (1.0 - fraction) * earlier + fraction * later

    # Between two states the tool turns by a few degrees, over which normalised quaternions are exact to 1e-4 rad.
    sign = 1.0 if float(before.T_world_tcp.wxyz @ after.T_world_tcp.wxyz) >= 0.0 else -1.0
    T_world_tcp = geometry.pose(
        mixed(before.T_world_tcp.position_m, after.T_world_tcp.position_m),
        mixed(before.T_world_tcp.wxyz, sign * after.T_world_tcp.wxyz),
    )
    return msgspec.structs.replace(
        before if fraction < 0.5 else after,
        stamp_ns=stamp_ns,
        q_rad=mixed(before.q_rad, after.q_rad),
        dq_rad_s=mixed(before.dq_rad_s, after.dq_rad_s),
        tau_nm=mixed(before.tau_nm, after.tau_nm),
        T_world_tcp=T_world_tcp,
        finger_width_m=(1.0 - fraction) * before.finger_width_m + fraction * after.finger_width_m,
    )
