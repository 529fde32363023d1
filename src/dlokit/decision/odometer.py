"""How far the tools have travelled, from what the robots say of themselves."""

from collections.abc import AsyncIterator

import numpy as np

from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState


class Odometer:
    """Adds up the way of every robot's tool centre point, sample by sample."""

    def __init__(self) -> None:
        self._last: dict[str, Float64Array] = {}
        self.travelled_m = 0.0
        """Of all tools together [m]; what is shorter than a sample apart is cut, a few millimetres in a metre."""

    async def follow(self, states: AsyncIterator[RobotState]) -> None:
        """Count for as long as there are states."""
        async for state in states:
            self.put(state)

    def put(self, state: RobotState) -> None:
        """Count the way from the robot's last state to this one."""
        here = state.T_world_tcp.position_m
        last = self._last.get(state.robot)
        if last is not None:
            self.travelled_m += float(np.linalg.norm(here - last))
        self._last[state.robot] = here
