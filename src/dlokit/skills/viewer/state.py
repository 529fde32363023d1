"""What the viewer knows of the run: newest messages, the lit box, the errors after each action."""

import enum
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from dlokit.skills.viewer.flow_chart import Edge
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import Command, FlowStatus

T = TypeVar("T")


class Fresh(Generic[T]):
    """Keeps one value until a newer one comes; hands each out once."""

    def __init__(self) -> None:
        self.value: T | None = None
        self.fresh = False

    def put(self, value: T) -> None:
        """A newer value."""
        self.value, self.fresh = value, True

    def again(self) -> None:
        """Hand the value out once more."""
        self.fresh = self.value is not None

    def take(self, use: Callable[[T], object]) -> bool:
        """Call `use` with the value when it is new; whether it was."""
        if not self.fresh or self.value is None:
            return False
        self.fresh = False
        use(self.value)
        return True


class RunState(enum.Enum):
    """What the buttons stand for now."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


def after_status(state: RunState, status: FlowStatus) -> RunState:
    """What a report of the flow says: an outcome is the end; a step runs, unless the operator paused it."""
    if status.outcome is not None:
        return RunState.ENDED
    return RunState.PAUSED if state is RunState.PAUSED else RunState.RUNNING


def after_command(state: RunState, command: Command) -> RunState:
    """What a button does to a running or pausing task; it starts and ends when the flow says so."""
    if command is Command.PAUSE and state is RunState.RUNNING:
        return RunState.PAUSED
    if command in (Command.RESUME, Command.STOP) and state is RunState.PAUSED:
        return RunState.RUNNING
    return state


class LitStep:
    """The box that was entered last. Reports that name no box of the chart, as the closing one, leave it lit."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self._boxes = {name for source, _, target in edges for name in (source, target)}
        self.step = ""
        self.last_outcome = ""

    def record(self, status: FlowStatus) -> None:
        """Take in a report of the flow."""
        if status.step in self._boxes:
            self.step, self.last_outcome = status.step, status.last_outcome


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
