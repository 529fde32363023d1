"""A lab without physics: a rope that follows at once, a camera that sees its centre line, an arm without errors.

Observer, model, planning and decision are the real ones; only the hardware's side (perception, robot) is scripted,
so that a test can provoke each branch of the flow chart.
"""

from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace

from scripted_hardware import LENGTH_M, NODES, Lab, ScriptedPerception, ScriptedRobot

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import Clock, LoopClock
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent
from dlokit.decision.config import TaskConfig
from dlokit.decision.journal import Journal
from dlokit.decision.records import ActionRecord, GoalRequest, ShapeResult
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.scene import Fixture
from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.observer.component import ObserverComponent
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.planning.component import PlanningComponent
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.skills.planning.servoing import ServoConfig
from dlokit.system.build import decision_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief
from dlokit.types.flow import Command, FlowStatus, GoalFrames, OperatorCommand
from dlokit.types.pose import Pose

I = builtin_shape("I", LENGTH_M, NODES)  # noqa: E741  the shape is called so
S = builtin_shape("S", LENGTH_M, NODES)


def lab(nodes: Float64Array = I) -> Lab:
    """A lab whose rope has this shape."""
    return Lab(nodes=nodes.copy())


@dataclass(frozen=True)
class Trace:
    """Result of a run in the ideal lab."""

    result: ShapeResult
    steps: list[tuple[str, str]]
    """(step, previous outcome), in order."""
    calls: list[str]
    belief: DloBelief | None
    """Belief about the DLO at the end."""

    def edges(self) -> set[tuple[str, str, str]]:
        """All arrows that were taken."""
        return {(a, outcome, b) for (a, _), (b, outcome) in zip(self.steps, self.steps[1:], strict=False)}


ROD = BelievedDlo(nodes=NODES, length_m=LENGTH_M)
EASY = ServoConfig(least_health=0.5)
"""The same value lowers the observer's confidence while the rope is held."""
PATIENT = TaskConfig(stall_actions=15, no_progress_actions=15)
"""The lab's rope has no friction, so that the shapes differ from the model's predictions, and runs take longer."""


def shape(
    lab: Lab,
    goal: Float64Array | None,
    config: TaskConfig | None = None,
    reachable: Callable[[Pose], bool] = lambda pose: True,
    operator: Callable[[FlowStatus], Command | GoalFrames | None] = lambda status: None,
    rod: BelievedDlo = ROD,
    planning: PlanningConfig | None = None,
    bus: Callable[[], MemoryTransport] = MemoryTransport,
    operator_takes_s: float = 0.0,
    fixtures: tuple[Fixture, ...] = (),
) -> Trace:
    """Run the shape task in the ideal lab on virtual time; without a goal, the operator sets it.

    `operator` may press a button at each step, or drag the frames and press "Shape it". `rod` is the DLO as the
    system believes it to be; `bus` makes what they talk over.
    """
    return virtual_time.run(
        _shape(lab, goal, config or PATIENT, reachable, operator, rod, planning, bus, operator_takes_s, fixtures)
    )


@asynccontextmanager
async def running(
    lab: Lab,
    transport: Transport,
    clock: Clock,
    config: TaskConfig | None = None,
    reachable: Callable[[Pose], bool] = lambda pose: True,
    rod: BelievedDlo = ROD,
    others: tuple[Component, ...] = (),
    planning: PlanningConfig | None = None,
    keep: Callable[[Journal], None] = lambda journal: None,
    fixtures: tuple[Fixture, ...] = (),
) -> AsyncGenerator[Container]:
    """The ideal lab's components on a bus, including the decision component, and `others`.

    `keep` gets the journals of its tasks, which believe in `fixtures`.
    """
    host = Container(transport, clock)
    task = replace(config or TaskConfig(), check_camera=lab.checks_camera)
    decision = DecisionComponent(task, lambda: 0.0, dlo=rod, keep=keep, fixtures=fixtures)
    for component in (
        ScriptedPerception(lab),
        ScriptedRobot(lab),
        ObserverComponent(ObserverConfig(), rod),
        ModelComponent(rod, FRANKA_HAND),
        PlanningComponent(planning or PlanningConfig(strategy=FarthestConfig(), servo=EASY), reachable, rod),
        *others,
        decision,
    ):
        host.add(component)
    async with host:
        await clock.sleep(0.1)
        yield host


async def _shape(
    lab: Lab,
    goal: Float64Array | None,
    config: TaskConfig,
    reachable: Callable[[Pose], bool],
    operator: Callable[[FlowStatus], Command | GoalFrames | None],
    rod: BelievedDlo,
    planning: PlanningConfig | None,
    bus: Callable[[], MemoryTransport],
    operator_takes_s: float,
    fixtures: tuple[Fixture, ...],
) -> Trace:
    steps: list[tuple[str, str]] = []
    recorded: list[ActionRecord] = []

    class Operator(Component):
        name = "viewer"
        publishes = (topics.COMMAND, topics.GOAL_FRAMES)
        reads = (topics.FLOW,)

        async def run(self) -> None:
            async for status in self.port.stream(topics.FLOW):
                if status.outcome is None:
                    steps.append((status.step, status.last_outcome))
                command = operator(status)
                if isinstance(command, GoalFrames):
                    self.port.publish(topics.GOAL_FRAMES, command)
                    command = Command.START
                if command is not None:
                    await self.port.clock.sleep(operator_takes_s)
                    now_ns = self.port.clock.now_ns()
                    self.port.publish(topics.COMMAND, OperatorCommand(stamp_ns=now_ns, command=command))

    transport = bus()
    transport.latest(topics.BELIEF)  # from here on, it is recorded
    others = (Operator(),)
    async with running(
        lab, transport, LoopClock(), config, reachable, rod, others, planning, fixtures=fixtures
    ) as host:
        request = None if goal is None else GoalRequest(nodes_world=goal, name="goal")
        result = await decision_of(host).shape(request, recorded.append)
        await host.clock.sleep(0.1)
    assert [record.action for record in recorded] == list(range(1, len(result.history) + 1))
    return Trace(result=result, steps=steps, calls=lab.calls, belief=transport.latest(topics.BELIEF).value)
