"""After an arm braked, or a component was lost: what is recovered, how often, and in which order."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs
from msgspec.structs import replace
from synthetic_clouds import state

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.attempt import ActionAttempt
from dlokit.decision.config import TaskConfig
from dlokit.decision.faults import RESTORABLE
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.records import Recovery
from dlokit.decision.steps import hands, put_down
from dlokit.decision.steps.outcomes import Done, Recovered, Restored
from dlokit.decision.steps.recover import recover, restore, take_over
from dlokit.decision.task import Odometer, ShapeTask, Spent, TaskGoal
from dlokit.errors import SkillFailure
from dlokit.skills.robot import api as robot
from dlokit.types.action import APPROACH_HEIGHT_M, Grasp, PickPlace, VelocityProfile
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, MotionResult, RobotReason, RobotState

TOOL = geometry.downward([0.5, 0.1, 0.02], 0.0)
STATE = structs.replace(
    ARM_AT_REST,
    T_world_tcp=TOOL,
    finger_width_m=0.008,
    holding=True,
)


@dataclass
class Script:
    """What the arm tells, which of its skills fail, and what it was told."""

    state: RobotState | None = STATE
    fails: dict[str, str] = field(default_factory=dict[str, str])
    fails_once: dict[str, str] = field(default_factory=dict[str, str])
    told: list[str] = field(default_factory=list[str])
    targets: list[Pose] = field(default_factory=list[Pose])
    paths: list[tuple[Pose, ...]] = field(default_factory=list[tuple[Pose, ...]])
    shape: DloState | None = None
    recovered_ns: int = -1

    def enter(self, skill: str) -> None:
        self.told.append(skill)
        if skill in self.fails_once:
            raise SkillFailure(self.fails_once.pop(skill), "as the script says")
        if skill in self.fails:
            raise SkillFailure(self.fails[skill], "as the script says")


class Arm(Component):
    name = "robot"
    publishes = (topics.ROBOT_STATE,)

    def __init__(self, script: Script) -> None:
        self._script = script

    async def run(self) -> None:
        if self._script.state is not None:
            self.port.publish(topics.ROBOT_STATE, self._script.state)

    @implements(robot.RECOVER)
    async def recover(self) -> None:
        self._script.enter("recover")
        self._script.recovered_ns = self.port.clock.now_ns()

    @implements(robot.RELEASE)
    async def release(self, width_m: float = 0.04) -> GripResult:
        self._script.enter("release")
        return GripResult(width_m=width_m, held=False)

    @implements(robot.FOLLOW_PATH)
    async def follow_path(self, path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
        self._script.enter("follow_path")
        self._script.paths.append(path)
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=path[-1], duration_s=0.0, largest_joint_error_rad=0.0)

    @implements(robot.MOVE_LINEAR)
    async def move_linear(self, target: Pose, velocity: VelocityProfile) -> MotionResult:
        self._script.enter("move_linear")
        self._script.targets.append(target)
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=target, duration_s=0.0, largest_joint_error_rad=0.0)


class Commander(Component):
    """The component that runs the task."""

    name = "decision"
    reads = (topics.ROBOT_STATE, topics.STATE, topics.COMMAND)


def alive(name: str) -> Component:
    """One of the components that may be lost, and is not."""
    return type("Alive", (Component,), {"name": name})()


def in_a_task(test: Callable[[ShapeTask], Awaitable[None]], script: Script | None = None, lost: str = "") -> None:
    """Run a test with a task whose only arm follows the script, in virtual time; the component `lost` is not there."""

    async def main() -> None:
        commander, transport = Commander(), MemoryTransport()
        host = Container(transport, LoopClock())
        for component in (Arm(script or Script()), commander, *(alive(name) for name in RESTORABLE if name != lost)):
            host.add(component)
        async with host:
            if script is not None and script.shape is not None:
                transport.publish(topics.STATE, script.shape)
            await asyncio.sleep(0.01)  # the arm has told its state
            port = commander.port
            task = ShapeTask(
                port=port,
                config=TaskConfig(),
                request=None,
                stopwatch=lambda: 0.0,
                states=port.stream(topics.STATE),
                commands=port.stream(topics.COMMAND),
                odometer=Odometer(),
                recorded=lambda row: None,
                spent=Spent(started_ns=0),
                reason="robot.follow_path: lease_lost",
                fault=RobotReason.LEASE_LOST,
            )
            await test(task)

    virtual_time.run(main())


def an_attempt(*, carrying: bool) -> ActionAttempt:
    grasp = Grasp(node=3, T_world_tcp=TOOL)
    return ActionAttempt(
        action=PickPlace(stamp_ns=0, grasp=grasp, path=(TOOL,), velocity=VelocityProfile()),
        before_world=np.zeros((31, 3)),
        began_ns=0,
        chosen_ns=0,
        tool_travelled_m=0.0,
        planning_time_s=0.0,
        carrying=carrying,
        ended_by=RobotReason.LEASE_LOST,
    )


@pytest.mark.parametrize(
    ("carrying", "holding", "fault", "then"),
    [
        (True, True, RobotReason.LEASE_LOST, Recovered.CARRYING),
        (True, False, RobotReason.LEASE_LOST, Recovered.DONE),
        (False, True, RobotReason.LEASE_LOST, Recovered.DONE),
        (True, True, RobotReason.REFLEX, Recovered.DONE),
    ],
)
def test_a_carry_goes_on_only_while_the_dlo_is_felt_and_nothing_was_touched(
    carrying: bool, holding: bool, fault: RobotReason, then: Recovered
) -> None:
    script = Script(state=replace(STATE, holding=holding))

    async def check(task: ShapeTask) -> None:
        task.attempt_under_way, task.fault = an_attempt(carrying=carrying), fault
        began_ns = task.port.clock.now_ns()
        assert await recover(task) is then
        assert task.attempt.ended_by == ("" if then is Recovered.CARRYING else RobotReason.LEASE_LOST)
        assert [(one.action, one.reason) for one in task.spent.recoveries] == [(1, fault)]
        assert script.recovered_ns - began_ns >= 100_000_000  # a frozen process has sent its heartbeat before

    in_a_task(check, script)
    assert script.told == ["recover"]


@pytest.mark.parametrize(
    ("before", "fault", "said"),
    [
        ((RobotReason.LEASE_LOST,) * hands.MOST_RECOVERIES, RobotReason.LEASE_LOST, "6 times"),
        ((RobotReason.REFLEX,), RobotReason.TRACKING, "needs a person"),
    ],
)
def test_an_arm_that_brakes_too_often_is_left_as_it_is(
    before: tuple[RobotReason, ...], fault: RobotReason, said: str
) -> None:
    script = Script()

    async def check(task: ShapeTask) -> None:
        task.attempt_under_way, task.fault = an_attempt(carrying=True), fault
        task.spent.recoveries = [Recovery(action=1, reason=reason) for reason in before]
        assert await recover(task) is Recovered.TOO_OFTEN
        assert task.reason is not None
        assert said in task.reason
        assert "lease_lost" in task.reason

    in_a_task(check, script)
    assert script.told == []


def test_a_fault_that_does_not_clear_is_the_step_s_fault() -> None:
    async def check(task: ShapeTask) -> None:
        task.attempt_under_way = an_attempt(carrying=True)
        with pytest.raises(StepFault, match="robot_lost"):
            await recover(task)

    in_a_task(check, Script(fails={"recover": RobotReason.ROBOT_LOST}))


def test_a_task_that_had_not_begun_an_action_begins_again_with_the_goal_that_the_operator_had_set() -> None:
    goal = GoalShape(stamp_ns=0, nodes_world=np.ones((31, 3)), name="drawn", ends_interchangeable=True)

    async def check(task: ShapeTask) -> None:
        task.goal_set = TaskGoal(shape=goal)
        assert await restore(task) is Restored.BEGIN
        assert task.request is not None
        assert np.array_equal(task.request.nodes_world, goal.nodes_world)
        assert (task.request.name, task.request.ends_interchangeable) == ("drawn", True)
        assert task.spent.interruptions == ["robot.follow_path: lease_lost"]

    in_a_task(check)


def test_components_that_are_lost_again_and_again_end_the_task() -> None:
    async def check(task: ShapeTask) -> None:
        ends = [await restore(task) for _ in range(5)]
        assert ends == [Restored.BEGIN] * 4 + [Restored.TOO_OFTEN]
        assert task.reason is not None
        assert "lost 5 times" in task.reason

    in_a_task(check)


@pytest.mark.parametrize("lost", RESTORABLE)
def test_a_component_that_does_not_return_is_named(lost: str) -> None:
    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault, match=f"^{lost} not restarted within") as failed:
            await restore(task)
        assert failed.value.kind is FaultKind.FAILED

    in_a_task(check, lost=lost)


def test_an_arm_that_is_taken_over_opens_before_it_moves_and_moves_straight_up() -> None:
    script = Script()

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told == ["recover", "release", "move_linear"]
    assert script.targets[0].position_m - TOOL.position_m == pytest.approx([0.0, 0.0, APPROACH_HEIGHT_M])


def held_up(tool: Pose) -> DloState:
    """A DLO of which a quarter lies on the table, along y, and the rest hangs from a tool that holds its last node."""
    x, y, z = tool.position_m
    lies = np.column_stack((np.full(8, x), np.linspace(y - 0.15, y, 8), np.full(8, 0.004)))
    hangs = np.column_stack((np.full(22, x), np.full(22, y), np.linspace(0.02, z, 22)))
    return state(np.concatenate((lies, hangs)))


UP = geometry.downward([0.5, -0.1, 0.35], 0.0)


def test_what_the_fingers_hold_in_the_air_is_put_down_before_they_open() -> None:
    script = Script(state=structs.replace(STATE, T_world_tcp=UP), shape=held_up(UP))

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told == ["recover", "follow_path", "release", "move_linear"]
    (path,) = script.paths
    assert path[-1].position_m == pytest.approx([0.5, 0.25, 0.004], abs=0.01)  # straight on, as long as it hangs


@pytest.mark.parametrize("shape", ["none", "elsewhere"])
def test_the_arm_is_not_lowered_where_the_shape_of_what_it_holds_is_unknown(shape: str) -> None:
    elsewhere = held_up(geometry.lifted(UP, -0.1))
    script = Script(state=structs.replace(STATE, T_world_tcp=UP), shape=None if shape == "none" else elsewhere)

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told == ["recover", "release", "move_linear"]


def test_a_dlo_for_which_no_path_down_is_allowed_is_let_go_where_it_is() -> None:
    refused = {"follow_path": RobotReason.FIXTURE_COLLISION}
    script = Script(state=structs.replace(STATE, T_world_tcp=UP), shape=held_up(UP), fails=dict(refused))

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told[0] == "recover"
    assert script.told[-2:] == ["release", "move_linear"]
    assert script.told.count("follow_path") == len(put_down.paths_down(held_up(UP).nodes_world, UP))


def test_fingers_that_have_no_room_to_open_beside_a_fixture_open_above_it() -> None:
    script = Script(fails_once={"release": RobotReason.FIXTURE_COLLISION})

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told == ["recover", "release", "move_linear", "release"]


def test_an_arm_whose_state_is_unknown_is_not_moved() -> None:
    script = Script(state=None)

    async def check(task: ShapeTask) -> None:
        assert await take_over(task) is Done.DONE

    in_a_task(check, script)
    assert script.told == ["recover", "release"]


@pytest.mark.parametrize(("reason", "ends"), [(RobotReason.UNREACHABLE, False), (RobotReason.ROBOT_LOST, True)])
def test_a_way_up_that_is_refused_is_left_to_the_move_home_and_a_broken_arm_is_not(
    reason: RobotReason, ends: bool
) -> None:
    async def check(task: ShapeTask) -> None:
        if ends:
            with pytest.raises(StepFault, match=reason):
                await take_over(task)
        else:
            assert await take_over(task) is Done.DONE

    in_a_task(check, Script(fails={"move_linear": reason}))
