"""A lab without physics: a rope that obeys at once, a camera that sees its middle line, an arm that never misses.

Observer, model, planning and decision are the real ones; only the hardware's side (perception, robot) is scripted,
so that each branch of the flow chart can be brought about.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.communication import topics, virtual_time
from dlokit.communication.clock import Clock, LoopClock
from dlokit.communication.component import Component, implements
from dlokit.communication.host import Host
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent
from dlokit.decision.config import TaskConfig
from dlokit.decision.task import ActionRecord, GoalRequest, ShapeResult
from dlokit.errors import SkillFailure
from dlokit.skills.model import api as model
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.model.config import ModelConfig
from dlokit.skills.observer import api as observer
from dlokit.skills.observer.component import ObserverComponent
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.perception import api as perception
from dlokit.skills.planning.component import PlanningComponent
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.skills.planning.servoing.config import ServoConfig
from dlokit.skills.robot import api as robot
from dlokit.types.action import VelocityProfile
from dlokit.types.dlo_belief import DloBelief
from dlokit.types.flow import Command, FlowStatus, GoalFrames, OperatorCommand
from dlokit.types.observation import Observation
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, MotionResult, RobotMode, RobotState

Array = NDArray[np.float64]
LENGTH_M = 0.5
NODES = 31


@dataclass
class Lab:
    """What the scripted hardware shares: the rope as it lies, and which skill fails when."""

    nodes: Array  # (NODES, 3) [m]
    fails: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    """Skill → the named failures of its next calls; an empty name succeeds."""
    holds: bool = True
    """Whether the gripper takes hold."""
    feels: bool = False
    """Whether the state of the arm says that the fingers hold something; the model then follows the tool."""
    slips: int = 0
    """How many of the next carries lose the rope half way."""
    obeys: bool = True
    """Whether the rope follows the gripper."""
    confuses_ends: bool = False
    """Whether the model loses track behind the arm and takes the rope for lying the other way round."""
    calls: list[str] = field(default_factory=list[str])

    def enter(self, skill: str) -> None:
        """Count a call, and fail it when the script says so."""
        self.calls.append(skill)
        script = self.fails.get(skill, [])
        if script and (reason := script.pop(0)):
            raise SkillFailure(reason, "by the script")


class ScriptedPerception(Component):
    """Sees points on the middle line of the rope."""

    name = "perception"
    publishes = (topics.OBSERVATION,)

    def __init__(self, lab: Lab) -> None:
        self._lab = lab

    @implements(perception.LOOK)
    async def look(self) -> Observation:
        self._lab.enter("look")
        points = geometry.resample(self._lab.nodes, 600).astype(np.float32)
        seen = Observation(stamp_ns=self.port.clock.now_ns(), points_world=points)
        self.port.publish(topics.OBSERVATION, seen)
        return seen

    @implements(perception.SET_TRACKING)
    async def set_tracking(self, rate_hz: float) -> None:
        self._lab.calls.append(f"tracking {rate_hz:g}")


class ScriptedRobot(Component):
    """An arm that is where it is sent, and a rope that is dragged by its nodes."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)

    def __init__(self, lab: Lab) -> None:
        self._lab = lab
        self._tcp = geometry.downward([0.3, 0.0, 0.4], 0.0)
        self._held: int | None = None
        self._shut = False
        self._stopped = asyncio.Event()

    async def run(self) -> None:
        while True:
            self._tell()
            await self.port.clock.sleep(0.1)

    def _motion(self, target: Pose) -> MotionResult:
        self._tcp = target
        self._tell()
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=target, duration_s=1.0, largest_joint_error_rad=0.0)

    def _pull(self, target: Pose) -> None:
        if self._held is not None and self._lab.obeys:
            self._lab.nodes = dragged(self._lab.nodes, self._held, target.position_m)

    def _tell(self) -> None:
        self.port.publish(
            topics.ROBOT_STATE,
            RobotState(
                stamp_ns=self.port.clock.now_ns(),
                robot="panda",
                q_rad=np.zeros(7),
                dq_rad_s=np.zeros(7),
                tau_nm=np.zeros(7),
                T_world_tcp=self._tcp,
                finger_width_m=0.04,
                mode=RobotMode.IDLE,
                holding=self._lab.feels and self._held is not None,
            ),
        )

    @implements(robot.HOME)
    async def home(self) -> MotionResult:
        self._lab.enter("home")
        await self.port.clock.sleep(1.0)
        return self._motion(geometry.downward([0.3, 0.0, 0.4], 0.0))

    @implements(robot.MOVE_TO)
    async def move_to(self, target: Pose, either_way: bool = True) -> MotionResult:
        self._lab.enter("move_to")
        await self.port.clock.sleep(1.0)
        return self._motion(target)

    @implements(robot.MOVE_LINEAR)
    async def move_linear(self, target: Pose, velocity: VelocityProfile) -> MotionResult:
        self._lab.enter("move_linear")
        self._pull(target)
        return self._motion(target)

    @implements(robot.GRASP)
    async def grasp(self, force_n: float = 20.0) -> GripResult:
        self._lab.enter("grasp")
        if self._lab.holds:
            self._hold_nearest()
        return GripResult(width_m=0.008 if self._lab.holds else 0.0, held=self._lab.holds)

    def _hold_nearest(self) -> None:
        self._held = int(np.argmin(np.linalg.norm(self._lab.nodes - self._tcp.position_m, axis=1)))

    @implements(robot.FOLLOW_PATH)
    async def follow_path(self, path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
        self._lab.enter("follow_path")
        if self._lab.slips > 0:
            await self._lose()
        await self.port.clock.sleep(2.0)
        if self._shut:
            self._hold_nearest()
        self._pull(path[-1])
        if self._lab.confuses_ends:
            await self.port.call(model.RESET)
            await self.port.call(perception.LOOK)
            await self.port.call(observer.INITIALISE, self.port.clock.now_ns(), self._lab.nodes[::-1].copy())
        return self._motion(path[-1])

    async def _lose(self) -> None:
        """The fingers close, and the arm goes on until it is told to stop."""
        self._lab.slips -= 1
        await self.port.clock.sleep(1.0)
        self._held = None
        await self.port.clock.sleep(5.0)
        if self._stopped.is_set():
            self._stopped.clear()
            raise SkillFailure("stopped", "as it was told")

    @implements(robot.RELEASE)
    async def release(self, width_m: float = 0.04) -> GripResult:
        self._lab.enter("release")
        self._held, self._shut = None, width_m == 0.0
        return GripResult(width_m=width_m, held=False)

    @implements(robot.RECOVER)
    async def recover(self) -> None:
        self._lab.enter("recover")

    @implements(robot.STOP)
    async def stop(self) -> None:
        self._lab.calls.append("stop")
        self._stopped.set()


def dragged(nodes: Array, held: int, to: Array) -> Array:
    """The rope after node `held` was moved: every other node is pulled along by its neighbour, rope length kept."""
    result = nodes.copy()
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    result[held, :2] = to[:2]
    for side in (range(held - 1, -1, -1), range(held + 1, len(nodes))):
        for i in side:
            leader = i + 1 if i < held else i - 1
            gap = result[i] - result[leader]
            result[i] = result[leader] + gap / np.linalg.norm(gap) * steps[min(i, leader)]
    return result


@dataclass(frozen=True)
class Trace:
    """What a run in the ideal lab left."""

    result: ShapeResult
    steps: list[tuple[str, str]]
    """(step, outcome that led there), in order."""
    calls: list[str]
    belief: DloBelief | None
    """What was believed of the DLO at the end."""

    def edges(self) -> set[tuple[str, str, str]]:
        """Every arrow that was taken."""
        return {(a, outcome, b) for (a, _), (b, outcome) in zip(self.steps, self.steps[1:], strict=False)}


ROD = ModelConfig(nodes=NODES, length_m=LENGTH_M)
EASY = ServoConfig(least_health=0.5)
"""The same makes the observer doubt what it sees while the rope is held."""
PATIENT = TaskConfig(stall_actions=15, hopeless_actions=15)
"""The lab's rope has no friction, so that other shapes come about than the model promises, and it takes longer."""


def shape(
    lab: Lab,
    goal: Array | None,
    config: TaskConfig | None = None,
    reachable: Callable[[Pose], bool] = lambda pose: True,
    operator: Callable[[FlowStatus], Command | GoalFrames | None] = lambda status: None,
    rod: ModelConfig = ROD,
    planning: PlanningConfig | None = None,
) -> Trace:
    """Run the shape task in the ideal lab on virtual time; without a goal it is the operator's.

    `operator` may press a button at each step, or drag the frames and press "Shape it". `rod` is the DLO as the
    system believes it to be.
    """
    return virtual_time.run(_shape(lab, goal, config or PATIENT, reachable, operator, rod, planning))


@asynccontextmanager
async def running(
    lab: Lab,
    transport: Transport,
    clock: Clock,
    config: TaskConfig | None = None,
    reachable: Callable[[Pose], bool] = lambda pose: True,
    rod: ModelConfig = ROD,
    others: tuple[Component, ...] = (),
    planning: PlanningConfig | None = None,
) -> AsyncGenerator[DecisionComponent]:
    """The ideal lab's components on a bus, the decision component among them, and `others`."""
    host = Host(transport, clock)
    decision = DecisionComponent(config or TaskConfig(), lambda: 0.0, length_m=rod.length_m, radius_m=rod.radius_m)
    for component in (
        ScriptedPerception(lab),
        ScriptedRobot(lab),
        ObserverComponent(ObserverConfig(), nodes=NODES, length_m=LENGTH_M),
        ModelComponent(rod),
        PlanningComponent(planning or PlanningConfig(strategy=FarthestConfig(), servo=EASY), reachable, rod),
        *others,
        decision,
    ):
        host.add(component)
    async with host:
        await clock.sleep(0.1)
        yield decision


async def _shape(
    lab: Lab,
    goal: Array | None,
    config: TaskConfig,
    reachable: Callable[[Pose], bool],
    operator: Callable[[FlowStatus], Command | GoalFrames | None],
    rod: ModelConfig,
    planning: PlanningConfig | None,
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
                    now_ns = self.port.clock.now_ns()
                    self.port.publish(topics.COMMAND, OperatorCommand(stamp_ns=now_ns, command=command))

    transport = MemoryTransport()
    transport.latest(topics.BELIEF)  # from here on it is kept
    async with running(lab, transport, LoopClock(), config, reachable, rod, (Operator(),), planning) as decision:
        request = None if goal is None else GoalRequest(nodes_world=goal, name="goal")
        result = await decision.shape(request, recorded.append)
        await decision.port.clock.sleep(0.1)
    assert [record.action for record in recorded] == list(range(1, len(result.history) + 1))
    return Trace(result=result, steps=steps, calls=lab.calls, belief=transport.latest(topics.BELIEF).value)
