"""The viewer's state of the run: newest messages, the active step, the errors after each action."""

import enum
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from dlokit.skills.viewer.panel.flow_chart import Edge
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import FlowStatus, RunPhase

T = TypeVar("T")


class Newest(Generic[T]):
    """Keeps the newest value; `take` uses each value once."""

    def __init__(self) -> None:
        self.value: T | None = None
        self.fresh = False

    def put(self, value: T) -> None:
        """Replace the value by a newer one."""
        self.value, self.fresh = value, True

    def again(self) -> None:
        """Mark the value as new again."""
        self.fresh = self.value is not None

    def take(self, use: Callable[[T], object]) -> bool:
        """Call `use` with the value if it is new; return whether it was."""
        if not self.fresh or self.value is None:
            return False
        self.fresh = False
        use(self.value)
        return True


class RunState(enum.Enum):
    """State of the task, which the buttons show."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


def after_status(state: RunState, status: FlowStatus) -> RunState:
    """The state after a status of the flow: ended with an outcome, else running, unless the operator paused it."""
    if status.outcome is not None:
        return RunState.ENDED
    return RunState.PAUSED if state is RunState.PAUSED else RunState.RUNNING


_OF_PHASES = {
    RunPhase.STARTING: RunState.WAITING,
    RunPhase.WAITING: RunState.WAITING,
    RunPhase.PAUSED: RunState.PAUSED,
    RunPhase.FINISHING: RunState.ENDED,
    RunPhase.ENDED: RunState.ENDED,
}


def of_phase(phase: RunPhase) -> RunState:
    """The state of the task in a phase of the run."""
    return _OF_PHASES.get(phase, RunState.RUNNING)


class ActiveStep:
    """The step that began last. A status without a step of the chart, as the last one, does not change it."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self._names = {name for source, _, target in edges for name in (source, target)}
        self.step = ""
        self.last_outcome = ""

    def record(self, status: FlowStatus) -> None:
        """Note a status of the flow."""
        if status.step in self._names:
            self.step, self.last_outcome = status.step, status.last_outcome


class ErrorHistory:
    """RMSE against the number of actions; cleared by a new run, whose actions begin again."""

    def __init__(self) -> None:
        self._rmse_m: dict[int, float] = {}
        self._actions = 0

    def record(self, status: FlowStatus) -> bool:
        """Note a status; return whether the history changed. The last error of each action is kept."""
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
