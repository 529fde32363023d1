"""Step by step: before each motion of the chart the run asks the operator, in the words of its step."""

from ideal_lab import I, lab, running

from dlokit.communication import topics
from dlokit.communication.component import Component
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.component import OperatorStart
from dlokit.decision.config import TaskConfig
from dlokit.decision.records import GoalRequest
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.description.shapes import moved
from dlokit.system.build import decision_of
from dlokit.types.flow import Command, OperatorCommand, RunPhase


class Allowing(Component):
    """Asks to be asked, and allows every motion."""

    name = "viewer"
    publishes = (topics.COMMAND,)
    reads = (topics.RUN,)

    def __init__(self) -> None:
        self.asked: list[str] = []

    async def run(self) -> None:
        async for status in self.port.stream(topics.RUN):
            if status.phase is RunPhase.ASKING:
                self.asked.append(status.asks)
            if status.phase is RunPhase.ASKING or not status.stepwise:
                command = Command.PROCEED if status.stepwise else Command.STEPWISE
                self.port.publish(topics.COMMAND, OperatorCommand(stamp_ns=1, command=command))


def test_each_motion_of_an_action_is_asked_for() -> None:
    operator = Allowing()

    async def run() -> None:
        async with running(
            lab(I), MemoryTransport(), LoopClock(), TaskConfig(max_actions=1), others=(operator,)
        ) as host:
            goal = GoalRequest(nodes_world=moved(I, (0.05, 0.0)), name="goal")
            await decision_of(host).shape(goal, lambda record: None)

    virtual_time.run(run())
    motions = {step.name: step.motion for step in SHAPE_DLO.steps if step.motion}
    assert operator.asked[-4:] == [motions[step] for step in ("approach", "grasp", "move_to_goal", "release")]


def test_the_motion_after_a_crash_is_asked_for_too() -> None:
    operator = Allowing()

    async def run() -> None:
        async with running(
            lab(I), MemoryTransport(), LoopClock(), TaskConfig(max_actions=1), others=(operator,)
        ) as host:
            decision = decision_of(host)
            decision.desk.command(Command.STEPWISE)
            goal = GoalRequest(nodes_world=moved(I, (0.05, 0.0)), name="goal")
            await decision.shape(goal, lambda record: None, start=OperatorStart(takes_over=True))

    virtual_time.run(run())
    assert operator.asked[0] == "lay what the fingers hold on the table, open them, and move straight up"
