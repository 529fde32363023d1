"""The state of a shape task while it runs."""

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
from dlokit.decision.operator import OperatorDesk
from dlokit.decision.records import ActionRecord, CameraReport, GoalRequest, Recovery
from dlokit.description.arm.mounts import INSTANCES
from dlokit.description.passing import passing
from dlokit.description.scene import Fixture
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import OperatorCommand
from dlokit.types.passing import Passing
from dlokit.types.robot import FIRST_ROBOT, RobotState

T = TypeVar("T")
P = ParamSpec("P")
R = TypeVar("R")


class Odometer:
    """Adds up the distance travelled by every robot's tool centre point, sample by sample."""

    def __init__(self) -> None:
        self._last: dict[str, Float64Array] = {}
        self.travelled_m = 0.0
        """Sum over all tools [m]; the path is cut short between samples, by a few millimetres per metre."""

    async def follow(self, states: AsyncIterator[RobotState]) -> None:
        """Count until the states end."""
        async for state in states:
            self.put(state)

    def put(self, state: RobotState) -> None:
        """Add the distance from the robot's previous state to this one."""
        here = state.T_world_tcp.position_m
        last = self._last.get(state.robot)
        if last is not None:
            self.travelled_m += float(np.linalg.norm(here - last))
        self._last[state.robot] = here


@dataclass(frozen=True, kw_only=True)
class TaskGoal:
    """The goal of a task."""

    shape: GoalShape
    """The shape that the task aims at."""
    verdict: GoalVerdict | None = None
    """Verdict on the requested goal; None before it is judged."""
    asked: GoalShape | None = None
    """The requested goal, if the nearest shape that holds has replaced it."""

    @property
    def doubtful(self) -> bool:
        """Whether the goal may not hold, so that the task ends sooner without progress."""
        if self.verdict is None or self.asked is not None:
            return False
        return self.verdict.standing is not Standing.HOLDS


@dataclass(kw_only=True)
class Spent:
    """What a task has used of its budgets, including the run that it resumes."""

    started_ns: int
    """When it began on the run's clock [ns]; earlier by the duration of the resumed run."""
    actions: int = 0
    """Actions of the resumed run."""
    planning_time_s: float = 0.0
    """On the machine's clock [s]."""
    recoveries: list[Recovery] = field(default_factory=list[Recovery])
    """Each time that the fault of an arm which braked on its own was cleared."""
    interruptions: list[str] = field(default_factory=list[str])
    """Why the task looked again, each time: a component or the camera was lost, or its clock jumped."""
    start_accepted: bool = False
    """Whether the resumed run had accepted its start: an arm that then opened may have dropped the DLO across
    itself."""


@dataclass(kw_only=True)
class ShapeTask:
    """The state of a running task; only the steps of the flow read and write it.

    `shape`, `goal` and `attempt` return the result of an earlier step; they raise `FlowError` if it has not run.
    """

    port: Port
    config: TaskConfig
    robots: tuple[str, ...] = (FIRST_ROBOT,)
    """Names of the arms, in the order of `INSTANCES`."""
    fixtures: tuple[Fixture, ...] = ()
    """Where they are believed to stand."""
    stopwatch: Callable[[], float]
    """The machine's monotonic clock [s], for timings alone."""
    odometer: Odometer
    states: AsyncIterator[DloState]
    commands: AsyncIterator[OperatorCommand]
    recorded: Callable[[ActionRecord], None]
    """Called with every action when its effect is known."""
    request: GoalRequest | None
    """None: the operator sets the goal in the viewer."""
    spent: Spent
    desk: OperatorDesk = field(default_factory=lambda: OperatorDesk(lambda status: None))
    """The operator's commands, and the status that is published for the page."""
    shown: bool = False
    """Whether the shape that the camera sees first is the goal; the operator then moves the DLO, and starts."""
    started_by: OperatorCommand | None = None
    """The operator's start, if it arrived before the task; None: the task waits for it, unless it has a request."""
    takes_over: bool = False
    """Whether the arms stayed where an earlier task stopped, perhaps with the DLO in their fingers."""
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
    """Component → the process that received its initial data: the DLO's shape, or the camera's pose. A process that was
    started later has not received them."""
    camera: CameraReport | None = None
    reason: str | None = None
    """Why the task ends, if it ends here; one line for people."""
    fault: str = ""
    """Name of the last failure, in the api of the skill that failed."""

    @property
    def instances(self) -> tuple[str, ...]:
        """The addresses of the arms."""
        return INSTANCES[: len(self.robots)]

    @property
    def shape(self) -> DloState:
        """The model's newest state."""
        return _known(self.state, "the shape")

    @property
    def goal(self) -> GoalShape:
        """The shape that the task aims at."""
        return _known(self.goal_set, "the goal").shape

    @property
    def attempt(self) -> ActionAttempt:
        """The current action."""
        return _known(self.attempt_under_way, "an action")

    @property
    def passing(self) -> Passing | None:
        """How the DLO passes the fixtures, by the model's newest state; None without fixtures, or before it is seen."""
        if not self.fixtures or self.state is None:
            return None
        seen, goal = self.state, None if self.goal_set is None else self.goal_set.shape
        return passing(
            seen.nodes_world,
            self.fixtures,
            () if goal is None else goal.beside,
            visible=seen.visible,
            covariance=seen.covariance,
            ends_interchangeable=goal is not None and goal.ends_interchangeable,
        )

    @property
    def unmet(self) -> str:
        """What of the goal's wish on posts is not met, or not seen to be; empty: nothing."""
        found = self.passing
        return "" if found is None else found.why

    @property
    def actions(self) -> int:
        """Number of actions that have ended, including those of the resumed run."""
        return self.spent.actions + len(self.history)

    @property
    def unfinished(self) -> bool:
        """Whether an action has begun whose effect is not known: of a task that has ended, its last action."""
        return self.attempt_under_way is not None and self.attempt_under_way.under_way

    async def ask(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a skill and return its result. Raises `StepFault` when it did not succeed."""
        return result_of(skill, await self.port.call(skill, *args, **kwargs))


def _known(value: T | None, what: str) -> T:
    if value is None:
        raise FlowError(f"a step needs {what} before another step has found it: the chart is wrong")
    return value
