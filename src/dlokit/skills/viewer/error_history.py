"""The error after each action, as the flow reports it."""

import numpy as np

from dlokit.types.arrays import Float64Array
from dlokit.types.flow import FlowStatus


class ErrorHistory:
    """RMSE against the number of actions. A new run, whose actions begin again, clears it."""

    def __init__(self) -> None:
        self._rmse_m: dict[int, float] = {}
        self._actions = 0

    def record(self, status: FlowStatus) -> bool:
        """Take in a report; whether anything changed. The last error known of each action counts."""
        before = dict(self._rmse_m)
        if status.actions < self._actions:
            self._rmse_m.clear()
        self._actions = status.actions
        if status.rmse_m is not None:
            self._rmse_m[status.actions] = status.rmse_m
        return self._rmse_m != before

    def arrays(self) -> tuple[Float64Array, Float64Array]:
        """Actions (n,) and RMSE (n,) [m]."""
        actions = sorted(self._rmse_m)
        return np.array(actions, dtype=np.float64), np.array([self._rmse_m[a] for a in actions], dtype=np.float64)
