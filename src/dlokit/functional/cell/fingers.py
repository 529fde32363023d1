"""The simulated hand: fingers that close at a set speed and press with a set force."""

from typing import Any

import numpy as np

from dlokit.description.arm.model import Gripper
from dlokit.types.arrays import Int64Array
from dlokit.types.robot import GripResult

_REST_SPEED_M_S = 0.002
"""Slower than this, a finger is at rest [m/s]."""
_REST_S = 0.05
"""For how long it must be slow [s]."""
_BLOCKED_M = 0.0005
"""A finger that rests that far from its target is blocked [m]."""
_FIRST_FORCE_N = 20.0
_THINNEST_M = 0.001
"""Smallest thickness that the fingers can detect [m]."""


class Fingers:
    """Both fingers of one hand; a width is the distance between the fingertips."""

    def __init__(self, model: Any, data: Any, *, name: str, gripper: Gripper) -> None:
        """Take over the fingers of the arm `name`, open them wide."""
        self._data = data
        joints = [f"{name}/finger_joint{i}" for i in (1, 2)]
        self._qpos: Int64Array = np.array([model.joint(label).qposadr[0] for label in joints], dtype=np.int64)
        self._dofs: Int64Array = np.array([model.joint(label).dofadr[0] for label in joints], dtype=np.int64)
        self._actuators: Int64Array = np.array([model.actuator(f"{name}/finger{i}").id for i in (1, 2)], dtype=np.int64)
        self._stiffness_n_m = float(model.actuator_gainprm[self._actuators[0], 0])
        self._speed_m_s = gripper.finger_speed_m_s
        self._goal_m = self._ramp_m = gripper.open_width_m / 2.0  # of each finger, from the middle
        self._force_n = _FIRST_FORCE_N
        self._slow_s = 0.0
        self._pressing = False
        self._data.qpos[self._qpos] = self._goal_m
        self._data.ctrl[self._actuators] = self._goal_m

    @property
    def width_m(self) -> float:
        """Measured distance between the fingertips."""
        return float(self._data.qpos[self._qpos].sum())

    @property
    def at_rest(self) -> bool:
        """Whether the last grip has ended: on its width, or on something in between."""
        return self._slow_s >= _REST_S

    @property
    def holding(self) -> bool:
        """Whether something is between the fingers and they press on it."""
        return self._pressing and self.width_m > max(2 * self._goal_m, 0.0) + _THINNEST_M

    def place(self, width_m: float) -> None:
        """Put the fingertips this far apart, at rest, without moving."""
        self._data.qpos[self._qpos] = width_m / 2.0
        self._data.qvel[self._dofs] = 0.0

    def start_grip(self, width_m: float, force_n: float) -> None:
        """Move to a width, pressing with at most `force_n` on whatever blocks the way."""
        self._goal_m, self._force_n = width_m / 2.0, force_n
        self._ramp_m = self.width_m / 2.0
        self._slow_s, self._pressing = 0.0, False

    def hold(self) -> None:
        """Stay where they are; what they press on they go on pressing on."""
        if self._pressing or self.at_rest:
            return
        self._goal_m = self._ramp_m = self.width_m / 2.0
        self._slow_s = _REST_S
        self._data.ctrl[self._actuators] = self._goal_m

    def result(self) -> GripResult:
        """How the grip ended."""
        return GripResult(width_m=self.width_m, held=self.holding)

    def before_step(self, timestep_s: float) -> None:
        """Set the controls for the next physics step."""
        if self._pressing or self.at_rest:
            return
        step = self._speed_m_s * timestep_s
        self._ramp_m += min(max(self._goal_m - self._ramp_m, -step), step)
        measured = self.width_m / 2.0
        reach = self._force_n / self._stiffness_n_m
        command = min(max(self._ramp_m, measured - reach), measured + reach)
        slow = bool(np.abs(self._data.qvel[self._dofs]).max() < _REST_SPEED_M_S)
        arrived = self._ramp_m == self._goal_m
        self._slow_s = self._slow_s + timestep_s if slow and (arrived or command > self._ramp_m) else 0.0
        if self.at_rest and measured > self._goal_m + _BLOCKED_M:
            # Something is in the way: from now on press with the whole force, whatever gives.
            self._pressing = True
            command = measured - reach
        self._data.ctrl[self._actuators] = command
