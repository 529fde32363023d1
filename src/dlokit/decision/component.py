"""The decision component: runs flows, publishes the current step, obeys the operator."""

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.communication.component import Component, holds, implements, implements_reporting, on
from dlokit.communication.container import end_tasks
from dlokit.decision import api
from dlokit.decision.config import Infeasible, TaskConfig
from dlokit.decision.convergence import error_m
from dlokit.decision.faults import BY_A_PERSON
from dlokit.decision.flow import End, StepFault, run_flow
from dlokit.decision.journal import Diary, Journal, TaskDiary, take_up
from dlokit.decision.operator import OperatorDesk
from dlokit.decision.records import ActionRecord, GoalRequest, ShapeResult, StepVisit
from dlokit.decision.shape_flow import resuming, task_chart
from dlokit.decision.steps.goal import operator_starts, see_goal
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.description.arm.mounts import INSTANCES
from dlokit.description.passing import check_wish
from dlokit.description.scene import Fixture
from dlokit.description.shapes import CURVE_POINTS, builtin_shape
from dlokit.errors import ConfigError, ShapeError, SkillFailure, SkillRejected
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.perception import api as perception
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.types.dlo import GoalShape
from dlokit.types.flow import Command, FlowStatus, OperatorCommand, RunOutcome, RunPhase, RunStatus
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import FIRST_ROBOT
from dlokit.types.system import StrategySpec


def goal_request(goal: str | GoalRequest, dlo: BelievedDlo) -> GoalRequest:
    """A built-in shape by its name, made for the length and radius of `dlo`; a curve is returned unchanged.

    Raises `SkillRejected` ``unknown_shape`` or ``bad_shape``.
    """
    if isinstance(goal, GoalRequest):
        return _checked(goal)
    try:
        nodes = builtin_shape(goal, dlo.length_m, CURVE_POINTS, radius_m=dlo.radius_m)
    except ShapeError as error:
        raise SkillRejected("unknown_shape", str(error)) from error
    return GoalRequest(nodes_world=nodes, name=goal)


def _checked(goal: GoalRequest) -> GoalRequest:
    nodes = goal.nodes_world
    if nodes.ndim != 2 or nodes.shape[1] != 3 or len(nodes) < 2 or not np.isfinite(nodes).all():
        raise SkillRejected(
            "bad_shape", f"the goal has the shape {nodes.shape}; (K, 3) finite metres, K >= 2, are needed"
        )
    return goal


def adjusted(
    config: TaskConfig, threshold_m: float | None, max_actions: int | None, infeasible: Infeasible | None
) -> TaskConfig:
    """The settings of one task. Raises `SkillRejected` ``bad_settings``."""
    try:
        return replace(
            config,
            threshold_m=config.threshold_m if threshold_m is None else threshold_m,
            max_actions=config.max_actions if max_actions is None else max_actions,
            infeasible=config.infeasible if infeasible is None else infeasible,
        )
    except ConfigError as error:
        raise SkillRejected("bad_settings", str(error)) from error


log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class OperatorStart:
    """How the operator of a task without a requested goal sets it and starts."""

    command: OperatorCommand | None = None
    """The start, where it came before the task; None: it is waited for."""
    shown: bool = False
    """Whether the shape that the camera sees first is the goal."""
    takes_over: bool = False
    """Whether an earlier task left the arms where they were, perhaps with the DLO in their fingers: it is put down."""


class DecisionComponent(Component):
    """Runs shape tasks; no other component calls the robot's skills."""

    name = "decision"
    # A thread of its process publishes the heartbeat while the leases are held.
    publishes = (topics.FLOW, topics.GRIPPED, topics.HEARTBEAT, topics.RUN)
    reads = (topics.STATE, topics.GOAL, topics.GOAL_FRAMES, topics.ROBOT_STATE, topics.COMMAND)

    def __init__(
        self,
        config: TaskConfig,
        stopwatch: Callable[[], float],
        *,
        dlo: BelievedDlo,
        robots: tuple[str, ...] = (FIRST_ROBOT,),
        fixtures: tuple[Fixture, ...] = (),
        keep: Callable[[Journal], None] = lambda journal: None,
        dry_run: bool = False,
    ) -> None:
        """`stopwatch` returns the machine's monotonic time [s], for timings only.

        Goals by name are made for `dlo`. `robots` are the names of the arms that it moves, `fixtures` stand around
        them. `keep` receives the journal of a task at each step. A `dry_run` simulates its first action with an arm in
        software and ends. The camera cannot see the hand of such an arm, so the camera's pose is not checked by it.
        """
        self._chart = task_chart(dry_run=dry_run, fixtures=bool(fixtures))
        if dry_run:
            config = replace(config, check_camera=False)
        self._keep = keep
        self._robots = robots
        self._config = config
        self._stopwatch = stopwatch
        self._dlo, self._fixtures = dlo, fixtures
        self._shaping = False
        self._flow: asyncio.Task[object] | None = None
        self._stopped_by = ""
        self._ended_by_a_person = False
        self.desk = OperatorDesk(self._publish_status)
        """The operator's commands, and the status of the run that the page shows."""

    @implements_reporting(api.SHAPE_DLO)
    async def shape_dlo(
        self,
        report: Callable[[api.ShapeProgress], None],
        goal: str | GoalRequest,
        threshold_m: float | None = None,
        max_actions: int | None = None,
        infeasible: Infeasible | None = None,
        planner: str | StrategySpec | None = None,
    ) -> ShapeResult:
        """Bring the DLO into a shape: the skill of the decision layer."""
        request = goal_request(goal, self._dlo)
        try:
            check_wish(request.beside or (), self._fixtures)
        except ConfigError as error:
            raise SkillRejected("unknown_post", str(error)) from error
        config = adjusted(self._config, threshold_m, max_actions, infeasible)
        await self._set_planner(planner)
        progress = TaskDiary(report)
        result = await self.shape(request, progress.recorded, progress.entered, config)
        task = asyncio.current_task()
        if task is not None and task.cancelling():
            raise asyncio.CancelledError  # by the caller; the robot is at rest
        if result.outcome is RunOutcome.FAILED:
            raise SkillFailure("task_failed", result.reason or "")
        return result

    async def shape(
        self,
        request: GoalRequest | None,
        recorded: Callable[[ActionRecord], None],
        entered: Callable[[FlowStatus], None] = lambda status: None,
        config: TaskConfig | None = None,
        resumed: Journal | None = None,
        canceller: Callable[[], str] = lambda: "",
        start: OperatorStart = OperatorStart(),
    ) -> ShapeResult:
        """Bring the DLO into the requested shape (None: the operator's, from the viewer, as described by `start`).

        `recorded` is called with every action when its effect is known, `entered` at every step. `config` applies to
        this task only. `resumed` is the journal of a task that a crash has ended. Raises `SkillRejected` ``busy`` while
        another task runs.

        Cancellation stops the robot and ends the task with outcome `cancelled`; a second cancellation is not
        caught. `canceller` then names the origin of the cancellation, for the result's reason; empty: the caller. A
        person's stop of an arm ends the task as `cancelled` too.
        """
        if (wrong := self._is_idle("")) is not None:
            raise SkillRejected(api.IDLE.reason, wrong)
        odometer, chart = Odometer(), self._chart
        with self._one_task():
            task = self._task(request, config or self._config, odometer, recorded)
            task.shown, task.started_by = start.shown, start.command
            if resumed is not None:
                take_up(task, resumed)
            if resumed is not None or start.takes_over:
                chart = resuming(chart)
            diary = Diary(chart, task, self.desk.gate, entered, self._keep)
            flow = asyncio.create_task(run_flow(chart, task, diary.entered, diary.faulted), name="shape_dlo")
            self._flow, self._stopped_by, self._ended_by_a_person = flow, "", False
            travelled = asyncio.create_task(odometer.follow(self.port.stream(topics.ROBOT_STATE)), name="odometer")
            try:
                outcome = await _outcome_of(
                    flow, task, lambda: self._stopped_by or canceller() or self._other_canceller()
                )
            finally:
                await end_tasks(travelled)
                self._flow = None
            if outcome is RunOutcome.FAILED and task.fault in BY_A_PERSON:  # the arm knew first that they stopped it
                outcome, self._ended_by_a_person = RunOutcome.CANCELLED, True
            if outcome in (RunOutcome.CANCELLED, RunOutcome.FAILED):
                await self._make_safe()
            _log_error(flow)  # after the arm has braked: writing a log line may block
            diary.close(outcome)
            return _result(task, outcome, tuple(diary.timings))

    @contextlib.contextmanager
    def _one_task(self) -> Generator[None]:
        """Refuse other tasks while the context is open, and publish that one runs."""
        self._shaping = True
        self.desk.task_begins()
        try:
            yield
        finally:
            self._shaping = False
            self.desk.publish(RunPhase.FINISHING if self.desk.status.stays else RunPhase.ENDED)

    def _task(
        self,
        request: GoalRequest | None,
        config: TaskConfig,
        odometer: Odometer,
        recorded: Callable[[ActionRecord], None],
    ) -> ShapeTask:
        return ShapeTask(
            port=self.port,
            config=config,
            request=request,
            stopwatch=self._stopwatch,
            states=self.port.stream(topics.STATE),
            commands=self.port.stream(topics.COMMAND),
            odometer=odometer,
            recorded=recorded,
            robots=self._robots,
            fixtures=self._fixtures,
            spent=Spent(started_ns=self.port.clock.now_ns()),
            desk=self.desk,
        )

    async def next_start(self, *, takes_over: bool = False) -> OperatorCommand | None:
        """Wait for the operator's next start between two tasks; None when the operator has ended the run.

        Meanwhile the operator may show a goal to the camera; with `takes_over` what the fingers hold is put down first.
        """
        task = self._task(None, self._config, Odometer(), lambda record: None)
        task.takes_over = takes_over
        started = asyncio.create_task(operator_starts(task), name="operator starts")
        ended = asyncio.create_task(self.desk.ends.wait(), name="operator ends")
        try:
            await asyncio.wait({started, ended}, return_when=asyncio.FIRST_COMPLETED)
            return None if self.desk.ends.is_set() else started.result()
        finally:
            await end_tasks(started, ended)

    @implements(api.SEE_GOAL)
    async def see_goal(self) -> GoalShape:
        """Take the shape that the camera sees as the goal."""
        self._shaping = True
        try:
            return await see_goal(self._task(None, self._config, Odometer(), lambda record: None))
        except StepFault as fault:
            raise SkillFailure(fault.reason or "not_seen", str(fault)) from fault
        finally:
            self._shaping = False

    @implements(api.STOP_TASK)
    async def stop_task(self, by: str = "") -> bool:
        """End the running task, whichever caller started it; a run that takes goal after goal waits for the next.

        A stop reaches the arms first, and their failed motion may end the task before this call arrives.
        """
        if not self._waits_for_a_goal() and self._stop_flow(by or "a call to end the task"):
            return True
        return self._ended_by_a_person

    def _waits_for_a_goal(self) -> bool:
        """Whether a run that takes goal after goal waits for the next one: there is no task to end.

        After a stop the arms are latched, and the goal is still waited for.
        """
        return self.desk.status.stays and self.desk.status.phase is RunPhase.WAITING

    def _other_canceller(self) -> str:
        return "the operator, who ended the run" if self.desk.ends.is_set() else "its caller"

    def _stop_flow(self, by: str) -> bool:
        """End the running flow; return whether one ran. `by` is for the result's reason; the first call is kept."""
        ending = self._flow is not None and self._flow.cancel()
        if ending:
            self._stopped_by = self._stopped_by or by
        return ending

    @holds(api.IDLE)
    def _is_idle(self, caller: str) -> str | None:
        """One task at a time."""
        return "another shape task runs; wait for it, or stop it" if self._shaping else None

    async def _set_planner(self, planner: str | StrategySpec | None) -> None:
        if planner is None:
            return
        spec = StrategySpec(name=planner) if isinstance(planner, str) else planner
        chosen = await self.port.call(planning.SET_STRATEGY, spec)
        if isinstance(chosen, Failed | Rejected):
            raise SkillRejected(chosen.reason, chosen.detail)
        if not isinstance(chosen, Succeeded):
            raise SkillFailure("task_failed", f"planning.set_strategy: {chosen}")

    async def _make_safe(self) -> None:
        """Brake, and stop tracking. Another cancellation ends the wait, but not the braking or the record.

        A person's stop is latched in the arms; after any other end of a task they are ready for the next.
        """
        brake = robot.STOP if self._stopped_by else robot.HALT

        async def stop_all() -> None:
            for instance in INSTANCES[: len(self._robots)]:
                await self.port.call(brake.at(instance))
            await self.port.call(perception.SET_TRACKING, 0.0)

        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.shield(stop_all())

    @on(topics.COMMAND)
    async def on_command(self, message: OperatorCommand) -> None:
        """Obey the operator; starts and shown goals are taken by the task that waits for them."""
        match message.command:
            case Command.STOP if not self._waits_for_a_goal():
                self._stop_flow("the viewer's Stop button")
            case Command.END:
                self.desk.end()
                if self._flow is not None:
                    self._flow.cancel()
            case command:
                self.desk.command(command)

    def _publish_status(self, status: RunStatus) -> None:
        self.port.publish(topics.RUN, msgspec.structs.replace(status, stamp_ns=self.port.clock.now_ns()))


async def _outcome_of(flow: "asyncio.Task[End]", task: ShapeTask, stopped_by: Callable[[], str]) -> RunOutcome:
    """How the flow ends: at an end of its chart, cancelled, or by a programming error, named in the task's reason."""
    try:
        return (await flow).outcome
    except asyncio.CancelledError:
        await end_tasks(flow)
        task.reason = f"stopped by {stopped_by()}"
        return RunOutcome.CANCELLED
    except Exception as error:  # the arm must not go on moving, and the actions so far must not be lost
        task.reason = f"{type(error).__name__}: {error}"
        return RunOutcome.FAILED


def _log_error(flow: "asyncio.Task[End]") -> None:
    if not flow.cancelled() and (error := flow.exception()) is not None:
        log.error("the flow raised", exc_info=error)


def _result(task: ShapeTask, outcome: RunOutcome, timings: tuple[StepVisit, ...]) -> ShapeResult:
    errors = task.errors_m or [math.nan]
    goal, start = task.goal_set, task.start
    asked = None if goal is None else goal.asked
    return ShapeResult(
        outcome=outcome,
        reason=None if outcome is RunOutcome.CONVERGED else task.reason,
        rmse_m=errors[-1],
        best_rmse_m=min(errors),
        goal=None if goal is None else goal.shape,
        start_nodes_world=start.nodes_world if start else None,
        start_stamp_ns=start.observed_stamp_ns if start else 0,
        start_rmse_m=task.errors_m[0] if task.errors_m else None,
        history=tuple(task.history),
        unfinished=task.unfinished,
        verdict=None if goal is None else goal.verdict,
        asked=asked,
        asked_rmse_m=None if asked is None or task.state is None else error_m(task.state.nodes_world, asked),
        timings=timings,
        planning_time_s=task.spent.planning_time_s,
        camera=task.camera,
        interruptions=tuple(task.spent.interruptions),
        recoveries=tuple(task.spent.recoveries),
        passing=task.passing,
    )
