"""The decision component: runs flows, tells everybody where it is, obeys the operator."""

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.decision.config import TaskConfig
from dlokit.decision.flow import run_flow
from dlokit.decision.odometer import Odometer
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.decision.task import ActionRecord, GoalRequest, ShapeResult, ShapeTask, StepTiming
from dlokit.geometry import rmse_m
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.flow import Command, FlowStatus, OperatorCommand, RunOutcome

log = logging.getLogger(__name__)


class DecisionComponent(Component):
    """The master: it alone calls the robot's skills."""

    name = "decision"
    publishes = (topics.FLOW, topics.GRIPPED)
    reads = (topics.STATE, topics.GOAL, topics.GOAL_FRAMES, topics.ROBOT_STATE, topics.COMMAND)

    def __init__(self, config: TaskConfig, stopwatch: Callable[[], float]) -> None:
        """`stopwatch` gives the machine's monotonic time [s]; it is used for timings alone."""
        self._config = config
        self._stopwatch = stopwatch
        self._running = asyncio.Event()
        self._running.set()

    async def shape(self, request: GoalRequest | None, recorded: Callable[[ActionRecord], None]) -> ShapeResult:
        """Bring the DLO into the requested shape (None: the operator's, from the viewer).

        `recorded` is told of every action when its effect is known.

        Cancelling it stops the robot and ends with outcome `cancelled`; a second cancellation gets through.
        """
        odometer = Odometer()
        task = ShapeTask(
            port=self.port,
            config=self._config,
            request=request,
            stopwatch=self._stopwatch,
            states=self.port.stream(topics.STATE),
            commands=self.port.stream(topics.COMMAND),
            odometer=odometer,
            recorded=recorded,
            started_ns=self.port.clock.now_ns(),
        )
        diary = _Diary(self, task)
        riding = asyncio.create_task(odometer.follow(self.port.stream(topics.ROBOT_STATE)), name="odometer")
        flow = asyncio.create_task(run_flow(SHAPE_DLO, task, diary.entered), name="shape_dlo")
        watch = asyncio.create_task(self._obey(flow), name="operator")
        try:
            outcome = (await flow).outcome
        except asyncio.CancelledError:
            flow.cancel()
            await asyncio.gather(flow, return_exceptions=True)
            outcome = RunOutcome.CANCELLED
            task.reason = "stopped by the operator"
        except Exception as error:  # a mistake of ours must not leave the arm moving, nor lose what was done so far
            log.exception("the flow raised")
            outcome = RunOutcome.FAILED
            task.reason = f"{type(error).__name__}: {error}"
        finally:
            watch.cancel()
            riding.cancel()
            await asyncio.gather(watch, riding, return_exceptions=True)
        if outcome in (RunOutcome.CANCELLED, RunOutcome.FAILED):
            await self._make_safe()
        diary.close(outcome)
        return _result(task, outcome, tuple(diary.timings))

    async def gate(self) -> None:
        """Wait while the operator has paused."""
        await self._running.wait()

    async def _make_safe(self) -> None:
        """Brake, and stop looking. Another cancellation ends the wait, but neither the braking nor the record."""

        async def stop_all() -> None:
            await self.port.call(robot.STOP)
            await self.port.call(perception.SET_TRACKING, 0.0)

        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.shield(stop_all())

    async def _obey(self, flow: "asyncio.Task[object]") -> None:
        async for message in self.port.stream(topics.COMMAND):
            match message:
                case OperatorCommand(command=Command.STOP):
                    flow.cancel()
                case OperatorCommand(command=Command.PAUSE):
                    self._running.clear()
                case OperatorCommand(command=Command.RESUME):
                    self._running.set()
                case _:
                    pass


class _Diary:
    """Publishes each box as it is entered, and measures how long it took."""

    def __init__(self, component: DecisionComponent, task: ShapeTask) -> None:
        self._component = component
        self._task = task
        self._since: tuple[str, int, float] | None = None
        self.timings: list[StepTiming] = []

    async def entered(self, step: str, last_outcome: str) -> None:
        await self._component.gate()
        self._stop_timing()
        self._since = (step, self._component.port.clock.now_ns(), self._task.stopwatch())
        self._publish(step, last_outcome, None)

    def close(self, outcome: RunOutcome) -> None:
        self._stop_timing()
        self._publish(outcome.value, "", outcome)

    def _stop_timing(self) -> None:
        if self._since is None:
            return
        step, since_ns, since_s = self._since
        now_ns = self._component.port.clock.now_ns()
        self.timings.append(
            StepTiming(step=step, cell_s=(now_ns - since_ns) / 1e9, machine_s=self._task.stopwatch() - since_s)
        )
        self._since = None

    def _publish(self, step: str, last_outcome: str, outcome: RunOutcome | None) -> None:
        task = self._task
        self._component.port.publish(
            topics.FLOW,
            FlowStatus(
                stamp_ns=self._component.port.clock.now_ns(),
                flow=SHAPE_DLO.name,
                step=step,
                last_outcome=last_outcome,
                actions=len(task.history),
                rmse_m=task.errors_m[-1] if task.errors_m else None,
                text=task.reason or "",
                outcome=outcome,
            ),
        )


def _error_to_asked(task: ShapeTask) -> float | None:
    if task.asked is None or task.state is None:
        return None
    asked = task.asked
    return rmse_m(task.state.nodes_world, asked.nodes_world, ends_interchangeable=asked.ends_interchangeable)


def _result(task: ShapeTask, outcome: RunOutcome, timings: tuple[StepTiming, ...]) -> ShapeResult:
    errors = task.errors_m or [math.nan]
    best = min(errors)
    return ShapeResult(
        outcome=outcome,
        reason=None if outcome is RunOutcome.CONVERGED else task.reason,
        rmse_m=errors[-1],
        best_rmse_m=best,
        best_action=errors.index(best),
        goal=task.goal,
        start_nodes_world=task.start.nodes_world if task.start else None,
        start_stamp_ns=task.start.observed_stamp_ns if task.start else 0,
        start_rmse_m=task.errors_m[0] if task.errors_m else None,
        history=tuple(task.history),
        verdict=task.verdict,
        asked=task.asked,
        asked_rmse_m=_error_to_asked(task),
        timings=timings,
        planning_time_s=task.planning_time_s,
    )
