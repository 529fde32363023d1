"""The viewer's state of the run: newest messages, the active step, the errors after each action."""

import enum
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

import numpy as np

from dlokit.skills.viewer.panel.flow_chart import Edge
from dlokit.skills.viewer.panel.operation import TASK_PHASES
from dlokit.types.action import Action, Candidates
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import FlowStatus, RunPhase, RunStatus, TaskEnd
from dlokit.types.image import CameraPictures
from dlokit.types.observation import Observation, ObserverEvent
from dlokit.types.robot import RobotState
from dlokit.types.system import StrategyChosen

T = TypeVar("T")


class Newest(Generic[T]):
    """Keeps the newest value; `take` uses each value once."""

    def __init__(self) -> None:
        self.value: T | None = None
        self.is_new = False

    def put(self, value: T) -> None:
        """Replace the value by a newer one."""
        self.value, self.is_new = value, True

    def forget(self) -> None:
        """Remove the value."""
        self.value, self.is_new = None, False

    def again(self) -> None:
        """Mark the value as new again."""
        self.is_new = self.value is not None

    def take(self, use: Callable[[T], object]) -> bool:
        """Call `use` with the value if it is new; return whether it was."""
        if not self.is_new or self.value is None:
            return False
        self.is_new = False
        use(self.value)
        return True


class RunState(enum.Enum):
    """State of the task, as the panel shows it."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


def after_status(state: RunState, status: FlowStatus) -> RunState:
    """The state after a status of the flow: ended with an outcome, paused if the operator paused it, else running."""
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
    """The step that began last. A status whose step is not in the chart, e.g. the final one, does not change it."""

    def __init__(self, edges: Sequence[Edge]) -> None:
        self._names = {name for source, _, target in edges for name in (source, target)}
        self.step = ""
        self.last_outcome = ""

    def record(self, status: FlowStatus) -> None:
        """Note a status of the flow."""
        if status.step in self._names:
            self.step, self.last_outcome = status.step, status.last_outcome


class ErrorHistory:
    """RMSE against the number of actions; cleared when the actions of a new task begin."""

    def __init__(self) -> None:
        self._rmse_m: dict[int, float] = {}
        self._actions = 0

    def record(self, status: FlowStatus) -> None:
        """Note a status. The last error of each action is kept."""
        if status.actions < self._actions:
            self._rmse_m.clear()
        self._actions = status.actions
        if status.rmse_m is not None:
            self._rmse_m[status.actions] = status.rmse_m

    def arrays(self) -> tuple[Float64Array, Float64Array]:
        """Actions (n,) and RMSE (n,) [m]."""
        actions = sorted(self._rmse_m)
        return np.array(actions, dtype=np.float64), np.array([self._rmse_m[a] for a in actions], dtype=np.float64)


class Received:
    """The newest message of each topic, and the state derived from the statuses of a run and its flow."""

    def __init__(self, flow: Sequence[Edge]) -> None:
        self.robots: dict[str, Newest[RobotState]] = {}
        self.pictures = Newest[CameraPictures]()
        self.segmentation = Newest[StrategyChosen]()
        self.cloud = Newest[Observation]()
        self.targets = Newest[TargetPoints]()
        self.event = Newest[ObserverEvent]()
        self.state = Newest[DloState]()
        self.goal = Newest[GoalShape]()
        self.verdict = Newest[GoalVerdict]()
        self.candidates = Newest[Candidates]()
        self.action = Newest[Action]()
        self.status = Newest[FlowStatus]()
        self.end = Newest[TaskEnd]()
        self.run = RunStatus(stamp_ns=0, phase=RunPhase.STARTING)
        self.run_state = RunState.WAITING
        self.history = ErrorHistory()
        self.active_step = ActiveStep(flow)

    @property
    def stop_latched(self) -> bool:
        """Whether a person's stop is latched in an arm."""
        return any(robot.value is not None and robot.value.stop_latched for robot in self.robots.values())

    @property
    def between_tasks(self) -> bool:
        """Whether the present task has ended, and its end is known."""
        run = self.run
        return run.phase not in TASK_PHASES and run.last is not None and run.last.number == run.task

    def record_run(self, status: RunStatus) -> TaskEnd | None:
        """Note a status of the run; return the task that ended with it, or None."""
        last, before = status.last, self.run.last
        self.run, self.run_state = status, of_phase(status.phase)
        self.status.again()
        if status.phase is RunPhase.ENDED:
            self.end.again()
        if last is None or (before is not None and (before.number, before.files) == (last.number, last.files)):
            return None
        self.end.put(last)
        return last

    def record_candidates(self, candidates: Candidates) -> None:
        """Note candidates. They begin the next decision, so an action that is not drawn yet is outdated."""
        self.action.forget()
        self.candidates.put(candidates)

    def record_flow(self, status: FlowStatus) -> None:
        """Note a status of the flow."""
        if self.run.phase is RunPhase.STARTING:  # a recording made before runs published their state
            self.run_state = after_status(self.run_state, status)
        self.history.record(status)
        self.active_step.record(status)
        self.status.put(status)
        if status.outcome is not None:
            self.action.forget()
            self.candidates.forget()
