"""What a shape task knows while it runs."""

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import ParamSpec, TypeVar

import numpy as np

from dlokit.communication.port import Port
from dlokit.communication.skill import Skill
from dlokit.decision.attempt import ActionAttempt, GraspMemory
from dlokit.decision.config import TaskConfig
from dlokit.decision.faults import result_of
from dlokit.decision.flow import FlowError
from dlokit.decision.records import ActionRecord, CameraReport, GoalRequest
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import OperatorCommand
from dlokit.types.robot import FIRST_ROBOT, RobotState

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")


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


@dataclass(frozen=True, kw_only=True)
class TaskGoal:
    """The goal of a task."""

    shape: GoalShape
    """What is shaped to."""
    verdict: GoalVerdict | None = None
    """On the goal that was asked for; None before it is judged."""
    asked: GoalShape | None = None
    """The goal that was asked for, when another one that holds took its place."""

    @property
    def doubtful(self) -> bool:
        """Whether the goal may not hold, so that the task must not go on for long without progress."""
        if self.verdict is None or self.asked is not None:
            return False
        return self.verdict.standing is not Standing.HOLDS


@dataclass(kw_only=True)
class Spent:
    """What a task has used of its budgets, that of the run which it resumes included."""

    started_ns: int
    """When it began on the cell's clock [ns]: earlier by what the run before had taken."""
    actions: int = 0
    """Actions of the run before."""
    planning_time_s: float = 0.0
    """On the machine's clock [s]."""
    recoveries: int = 0
    """How often an arm that braked by itself was cleared."""
    restorations: int = 0
    """How often a component was lost and waited for."""
    start_accepted: bool = False
    """Whether the run before had begun from its start: an arm that then let go may have dropped the DLO across
    itself."""


@dataclass(kw_only=True)
class ShapeTask:
    """The state of a running task; the boxes of the flow read and write it, nobody else.

    What a box before has found is read by `shape`, `goal` and `attempt`; they raise `FlowError` where none has.
    """

    port: Port
    config: TaskConfig
    robots: tuple[str, ...] = (FIRST_ROBOT,)
    """Names of the arms."""
    stopwatch: Callable[[], float]
    """The machine's monotonic clock [s], for timings alone."""
    odometer: Odometer
    states: AsyncIterator[DloState]
    commands: AsyncIterator[OperatorCommand]
    recorded: Callable[[ActionRecord], None]
    """Told of every action when its effect is known."""
    request: GoalRequest | None
    """None: the operator sets the goal in the viewer."""
    spent: Spent
    goal_set: TaskGoal | None = None
    state: DloState | None = None
    """The model's newest state."""
    start: DloState | None = None
    errors_m: list[float] = field(default_factory=list[float])
    """RMSE before the first action and after each [m]."""
    grasps: GraspMemory = field(default_factory=GraspMemory)
    attempt_under_way: ActionAttempt | None = None
    """The last action that was chosen."""
    history: list[ActionRecord] = field(default_factory=list[ActionRecord])
    servers: dict[str, str] = field(default_factory=dict[str, str])
    """Component → the process of it that was told what it must know: where the DLO lies, or the camera stands. One that
    was started since knows nothing of it."""
    camera: CameraReport | None = None
    reason: str | None = None
    """Why it ends, should it end here; one line for people."""

    @property
    def shape(self) -> DloState:
        """The model's newest state."""
        return _known(self.state, "the shape")

    @property
    def goal(self) -> GoalShape:
        """What is shaped to."""
        return _known(self.goal_set, "the goal").shape

    @property
    def attempt(self) -> ActionAttempt:
        """The action under way."""
        return _known(self.attempt_under_way, "an action")

    @property
    def actions(self) -> int:
        """How many have ended, those of a run that this one resumes among them."""
        return self.spent.actions + len(self.history)

    async def ask(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a skill; its result. Raises `StepFault` where it did not succeed."""
        return result_of(skill, await self.port.call(skill, *args, **kwargs))


def _known(value: T | None, what: str) -> T:
    if value is None:
        raise FlowError(f"a box needs {what} before another has found it: the chart is wrong")
    return value
