"""`shape_dlo` as a skill: called over a bus, as part of a larger task, in the ideal lab."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest
from buses import new_bus
from ideal_lab import PATIENT, I, running
from scripted_hardware import LENGTH_M, NODES, Lab

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock, FollowedClock, LoopClock
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.decision.api import SHAPE_DLO, STOP_TASK, ShapeProgress
from dlokit.decision.records import GoalRequest
from dlokit.description.shapes import builtin_shape, moved
from dlokit.system.build import decision_of
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.shaping import Watcher, shape
from dlokit.types.flow import Command, OperatorCommand, RunOutcome
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded

LIMIT_S = 60.0  # a task takes a second of the machine's time; only one that hangs needs more than this
AWAY = moved(builtin_shape("I", LENGTH_M, NODES), (0.0, 0.03))
"""A rope that two actions bring to the built-in I."""

Body = Callable[[Transport, Lab], Awaitable[None]]
Bus = Callable[[Body], None]


def in_memory(body: Body) -> None:
    async def main() -> None:
        lab, bus = Lab(nodes=AWAY.copy()), MemoryTransport()
        async with running(lab, bus, LoopClock()):
            await body(bus, lab)

    virtual_time.run(main())


def over_zenoh(body: Body) -> None:
    async def main() -> None:
        lab, bus = Lab(nodes=AWAY.copy()), new_bus()
        async with (
            asyncio.timeout(LIMIT_S),
            hurried() as clock,
            on_zenoh(bus.first()) as far,
            on_zenoh(bus.guest) as near,
            running(lab, far, clock),
        ):
            assert await near.wait_for(SHAPE_DLO.component, LIMIT_S)
            await body(near, lab)

    asyncio.run(main())


@asynccontextmanager
async def on_zenoh(config: ZenohConfig) -> AsyncGenerator[ZenohTransport]:
    transport = ZenohTransport(config)  # limits of calls by the machine's clock: the hurried one is too fast for them
    try:
        yield transport
    finally:
        await transport.close()


@asynccontextmanager
async def hurried() -> AsyncGenerator[Clock]:
    """A clock that advances whenever the loop is idle."""
    clock = FollowedClock()

    async def tick() -> None:
        while True:
            await asyncio.sleep(0.001)
            clock.tick(clock.now_ns() + 20_000_000)

    ticking = asyncio.create_task(tick())
    try:
        yield clock
    finally:
        ticking.cancel()


@pytest.fixture(
    params=[pytest.param(in_memory, id="memory"), pytest.param(over_zenoh, id="zenoh", marks=pytest.mark.live)]
)
def on_bus(request: pytest.FixtureRequest) -> Bus:
    return request.param


def test_a_task_called_over_the_bus_reaches_its_goal_and_reports_progress(on_bus: Bus) -> None:
    told: list[ShapeProgress] = []

    async def body(bus: Transport, lab: Lab) -> None:
        outcome = await bus.call_reported(SHAPE_DLO, told.append, "I", threshold_m=0.015)
        assert isinstance(outcome, Succeeded), outcome
        result = outcome.result
        assert result.outcome is RunOutcome.CONVERGED
        assert result.rmse_m < 0.015
        assert result.history
        assert [step.action.action for step in told if step.action is not None] == [
            record.action for record in result.history
        ]

    on_bus(body)
    steps = [step.step for step in told]
    assert steps[:3] == ["check_camera", "find_dlo", "set_goal"]
    assert steps[-1] == "converged"


def test_a_task_with_a_curve_as_goal_uses_the_callers_settings(on_bus: Bus) -> None:
    async def body(bus: Transport, lab: Lab) -> None:
        goal = GoalRequest(nodes_world=builtin_shape("S", LENGTH_M, 60), name="mine")
        outcome = await bus.call(SHAPE_DLO, goal, max_actions=1)
        assert isinstance(outcome, Succeeded), outcome
        assert outcome.result.outcome is RunOutcome.BUDGET
        assert len(outcome.result.history) == 1
        assert outcome.result.goal is not None
        assert outcome.result.goal.name == "mine"

    on_bus(body)


def test_a_second_task_is_rejected_as_busy_and_the_first_continues(on_bus: Bus) -> None:
    async def body(bus: Transport, lab: Lab) -> None:
        began = asyncio.Event()
        first = asyncio.create_task(bus.call_reported(SHAPE_DLO, lambda step: began.set(), "S", max_actions=1))
        await began.wait()
        second = await bus.call(SHAPE_DLO, "I")
        assert isinstance(second, Rejected)
        assert second.reason == "busy"
        assert isinstance(await first, Succeeded)

    on_bus(body)


def test_a_cancelled_task_stops_the_robot_and_the_next_one_may_begin(on_bus: Bus) -> None:
    async def body(bus: Transport, lab: Lab) -> None:
        carrying = asyncio.Event()

        def told(step: ShapeProgress) -> None:
            if step.step == "move_to_goal":
                carrying.set()

        task = asyncio.create_task(bus.call_reported(SHAPE_DLO, told, "S"))
        await carrying.wait()
        assert "halt" not in lab.calls
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        # The caller continues only after the robot has stopped.
        assert "halt" in lab.calls
        assert isinstance(await bus.call(SHAPE_DLO, "I", max_actions=1), Succeeded)

    on_bus(body)


@pytest.mark.parametrize(
    ("goal", "threshold_m", "planner", "reason"),
    [
        ("Z", None, None, "unknown_shape"),
        (GoalRequest(nodes_world=np.zeros((1, 3)), name="a point"), None, None, "bad_shape"),
        (GoalRequest(nodes_world=np.full((5, 3), np.nan), name="nowhere"), None, None, "bad_shape"),
        ("S", -1.0, None, "bad_settings"),
        ("S", None, "tea_leaves", "unknown_strategy"),
    ],
)
def test_invalid_requests_are_rejected_by_name_before_the_robot_moves(
    goal: str | GoalRequest, threshold_m: float | None, planner: str | None, reason: str
) -> None:
    async def body(bus: Transport, lab: Lab) -> None:
        outcome = await bus.call(SHAPE_DLO, goal, threshold_m=threshold_m, planner=planner)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == reason
        assert not lab.calls
        # Nothing of it affects the next task.
        assert isinstance(await bus.call(SHAPE_DLO, "I", max_actions=1), Succeeded)

    in_memory(body)


def test_a_task_that_the_robot_does_not_carry_out_fails_by_name() -> None:
    async def body(bus: Transport, lab: Lab) -> None:
        lab.fails["home"] = ["robot_lost"]
        outcome = await bus.call(SHAPE_DLO, "S")
        assert isinstance(outcome, Failed)
        assert outcome.reason == "task_failed"
        assert "robot_lost" in outcome.detail

    in_memory(body)


class Operator(Component):
    name = "viewer"
    publishes = (topics.COMMAND,)
    reads = (topics.FLOW,)

    async def run(self) -> None:
        async for status in self.port.stream(topics.FLOW):
            if status.step == "choose_grasp":
                for command in (Command.PAUSE, Command.STOP):
                    now_ns = self.port.clock.now_ns()
                    self.port.publish(topics.COMMAND, OperatorCommand(stamp_ns=now_ns, command=command))
                return


def test_the_operators_stop_is_a_result_and_a_pause_ends_with_its_task() -> None:
    async def main() -> None:
        bus, lab = MemoryTransport(), Lab(nodes=AWAY.copy())
        async with running(lab, bus, LoopClock(), others=(Operator(),)):
            outcome = await bus.call(SHAPE_DLO, "S")
            assert isinstance(outcome, Succeeded)
            assert outcome.result.outcome is RunOutcome.CANCELLED
            assert isinstance(await bus.call(SHAPE_DLO, "I", max_actions=1), Succeeded)

    virtual_time.run(main())


class Shell(Component):
    """Stops the task from outside, as `dlokit stop` does."""

    name = "viewer"
    reads = (topics.FLOW,)

    def __init__(self) -> None:
        super().__init__()
        self.said: list[Outcome[bool]] = []

    async def run(self) -> None:
        async for status in self.port.stream(topics.FLOW):
            if status.step == "choose_grasp":
                self.said.append(await self.port.call(STOP_TASK, "process 4711 (dlokit stop)"))
                return


def test_a_caller_without_the_operators_buttons_ends_the_task_by_a_skill() -> None:
    async def main() -> None:
        bus, lab = MemoryTransport(), Lab(nodes=AWAY.copy())
        shell = Shell()
        async with running(lab, bus, LoopClock(), others=(shell,)):
            outcome = await bus.call(SHAPE_DLO, "S")
            assert isinstance(outcome, Succeeded)
            assert outcome.result.outcome is RunOutcome.CANCELLED
            assert outcome.result.reason == "stopped by process 4711 (dlokit stop)"
            assert lab.calls[-2:] == ["stop", "tracking 0"]
            shell.said.append(await bus.call(STOP_TASK))
        assert [isinstance(said, Succeeded) and said.result for said in shell.said] == [True, False]

    virtual_time.run(main())


def test_a_task_that_the_stopped_arm_has_ended_counts_as_stopped_until_the_next_task() -> None:
    async def main() -> None:
        bus, lab = MemoryTransport(), Lab(nodes=AWAY.copy(), fails={"move_to": ["stopped"]})
        said = list[Outcome[bool]]()
        async with running(lab, bus, LoopClock()):
            stopped = await bus.call(SHAPE_DLO, "S")
            said.append(await bus.call(STOP_TASK, "process 4711 (dlokit stop)"))
            ended = await bus.call(SHAPE_DLO, "I", max_actions=1)
            said.append(await bus.call(STOP_TASK))
        assert isinstance(stopped, Succeeded)
        assert stopped.result.outcome is RunOutcome.CANCELLED
        assert isinstance(ended, Succeeded)
        assert [isinstance(one, Succeeded) and one.result for one in said] == [True, False]

    virtual_time.run(main())


@pytest.mark.parametrize(("canceller", "reason"), [("SIGTERM", "stopped by SIGTERM"), ("", "stopped by its caller")])
def test_a_cancelled_task_names_its_canceller(canceller: str, reason: str) -> None:
    async def main() -> None:
        lab = Lab(nodes=AWAY.copy())
        async with running(lab, MemoryTransport(), LoopClock()) as host:
            goal = GoalRequest(nodes_world=builtin_shape("S", LENGTH_M, NODES), name="S")
            shaping = asyncio.create_task(
                decision_of(host).shape(goal, lambda record: None, canceller=lambda: canceller)
            )
            await asyncio.sleep(0.5)
            shaping.cancel()
            result = await shaping
        assert (result.outcome, result.reason) == (RunOutcome.CANCELLED, reason)

    virtual_time.run(main())


class SlowToLeave(MemoryTransport):
    """Takes a second to end a subscription to the viewer's page."""

    def __init__(self) -> None:
        super().__init__()
        self.leaves = asyncio.Event()

    def stream(self, topic: Topic[Any], *, with_last: bool = False) -> Any:
        stream = super().stream(topic, with_last=with_last)
        return self._slow(stream) if topic is topics.VIEWER_PAGE else stream

    async def _slow(self, stream: Any) -> AsyncGenerator[Any]:
        try:
            async for message in stream:
                yield message
        finally:
            self.leaves.set()
            await asyncio.sleep(1.0)


def test_a_task_that_is_cancelled_after_its_end_keeps_its_result() -> None:
    async def body() -> None:
        lab, bus, clock = Lab(nodes=I.copy()), SlowToLeave(), LoopClock()
        job = ShapeJob(name="I to I", start_nodes_world=I, request=GoalRequest(nodes_world=I, name="I"))
        async with running(lab, bus, clock, PATIENT) as host:
            task = asyncio.create_task(shape(host, RunConfig(task=PATIENT), job, Watcher()))
            await bus.leaves.wait()
            task.cancel()
            record = await task
        assert record.result.outcome is RunOutcome.CONVERGED

    virtual_time.run(body())
