"""Concurrent motions of a pair's arms, with two arms whose motions end as scripted."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.attempt import ActionAttempt
from dlokit.decision.config import TaskConfig
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.steps import hands
from dlokit.decision.steps.act import approach
from dlokit.decision.steps.hands import follow_while_held, place_in_tool
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.description.arm.mounts import ROBOTS, SECOND
from dlokit.errors import SkillFailure
from dlokit.skills.robot import api as robot
from dlokit.types.action import Grasp, PairPlace, Partner, VelocityProfile
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT, GripResult, MotionResult, Remedy, RobotMode, RobotReason

TOOL = geometry.downward([0.5, 0.1, 0.004], 0.0)
NODE, PARTNERS_NODE = 3, 27


@dataclass
class Script:
    """Scripted ends of one arm's motions, and the commands it received."""

    motion_s: float = 2.0
    fails: str = ""
    """Reason of the failure after half of the motion."""
    loses_at_s: float = float("inf")
    """When the fingers close on nothing, counted from the start of the motion."""
    holds: bool = True
    comes_above: bool = True
    """Whether the other arm leaves the place above its grasp free."""
    home_needs: "Script | None" = None
    """The arm that must be home before this one can move there."""
    is_home: bool = False
    told: list[str] = field(default_factory=list[str])


class Arm(Component):
    """An arm that follows its script."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)

    def __init__(self, script: Script, instance: str) -> None:
        self._script, self.instance = script, instance
        self._stopped = asyncio.Event()

    @implements(robot.FOLLOW_PATH)
    async def follow_path(self, path: tuple[Pose, ...], velocity: VelocityProfile) -> MotionResult:
        self._script.told.append("follow_path")
        for tick in range(round(self._script.motion_s / 0.1)):
            self._tell(holding=0.1 * tick < self._script.loses_at_s)
            await self.port.clock.sleep(0.1)
            if self._stopped.is_set():
                raise SkillFailure("stopped", "as it was told")
            if self._script.fails and 0.2 * tick > self._script.motion_s:
                raise SkillFailure(self._script.fails, "as the script says")
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=path[-1], duration_s=2.0, largest_joint_error_rad=0.0)

    @implements(robot.RELEASE)
    async def release(self, width_m: float = 0.04) -> GripResult:
        return GripResult(width_m=width_m, held=False)

    @implements(robot.MOVE_TO)
    async def move_to(self, target: Pose, either_way: bool = True) -> MotionResult:
        if not self._script.comes_above:
            raise SkillFailure("arms_too_near", "as the script says")
        self._script.is_home = False
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=target, duration_s=0.0, largest_joint_error_rad=0.0)

    @implements(robot.GRASP)
    async def grasp(self, force_n: float = 20.0) -> GripResult:
        return GripResult(width_m=0.008 if self._script.holds else 0.0, held=self._script.holds)

    @implements(robot.HOME)
    async def home(self) -> MotionResult:
        self._script.told.append("home")
        if self._script.home_needs is not None and not self._script.home_needs.is_home:
            raise SkillFailure("arms_too_near", "as the script says")
        self._script.is_home = True
        return MotionResult(q_rad=np.zeros(7), T_world_tcp=TOOL, duration_s=0.0, largest_joint_error_rad=0.0)

    @implements(robot.HALT)
    async def halt(self) -> None:
        self._script.told.append("stop")
        self._stopped.set()

    def _tell(self, *, holding: bool) -> None:
        self.port.publish(
            topics.ROBOT_STATE.at(self.instance),
            structs.replace(
                ARM_AT_REST,
                stamp_ns=self.port.clock.now_ns(),
                robot=self.instance or FIRST_ROBOT,
                T_world_tcp=TOOL,
                finger_width_m=0.008,
                mode=RobotMode.MOVING,
                holding=holding,
            ),
        )


class Commander(Component):
    """The component that runs the task."""

    name = "decision"
    reads = (topics.ROBOT_STATE, topics.STATE, topics.COMMAND)


def _pair() -> PairPlace:
    partner = Partner(
        robot=SECOND,
        grasp=Grasp(node=PARTNERS_NODE, T_world_tcp=TOOL),
        path=(TOOL,),
        velocity=VelocityProfile(),
    )
    grasp = Grasp(node=NODE, T_world_tcp=TOOL)
    return PairPlace(stamp_ns=0, grasp=grasp, path=(TOOL,), velocity=VelocityProfile(), partner=partner)


def with_two_arms(first: Script, second: Script, test: Callable[[ShapeTask], Awaitable[None]]) -> None:
    async def main() -> None:
        bus, clock = MemoryTransport(), LoopClock()
        host = Container(bus, clock, instances={"robot": (SECOND,)})
        commander = Commander()
        for component in (Arm(first, ""), Arm(second, SECOND), commander):
            host.add(component)
        async with host:
            task = ShapeTask(
                port=commander.port,
                config=TaskConfig(),
                robots=ROBOTS,
                request=None,
                stopwatch=lambda: 0.0,
                states=commander.port.stream(topics.STATE),
                commands=commander.port.stream(topics.COMMAND),
                odometer=Odometer(),
                recorded=lambda row: None,
                spent=Spent(started_ns=0),
                attempt_under_way=ActionAttempt(
                    action=_pair(),
                    before_world=np.zeros((31, 3)),
                    began_ns=0,
                    chosen_ns=0,
                    tool_travelled_m=0.0,
                    planning_time_s=0.0,
                ),
            )
            await test(task)

    virtual_time.run(main())


def test_both_hands_move_and_neither_is_stopped() -> None:
    first, second = Script(), Script(motion_s=3.0)

    async def check(task: ShapeTask) -> None:
        await hands.follow_paths(task)
        assert task.port.clock.now_ns() == pytest.approx(3.0e9)  # as long as the longer motion, not the sum

    with_two_arms(first, second, check)
    assert first.told == second.told == ["follow_path"]


@pytest.mark.parametrize("fails", [0, 1])
def test_when_one_hand_fails_the_other_is_stopped_and_the_failure_is_raised(fails: int) -> None:
    scripts = (Script(), Script())
    scripts[fails].fails = "joint_limit"

    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault) as failed:
            await hands.follow_paths(task)
        assert failed.value.reason == "joint_limit"

    with_two_arms(*scripts, check)
    assert scripts[fails].told == ["follow_path"]
    assert scripts[1 - fails].told == ["follow_path", "stop"]


@pytest.mark.parametrize("reason", [reason for reason in RobotReason if reason.remedy is Remedy.ANOTHER_TARGET])
def test_a_motion_that_the_gate_refuses_leads_to_another_grasp(reason: str) -> None:
    first, second = Script(), Script()
    first.fails = reason

    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault) as refused:
            await hands.follow_paths(task)
        assert refused.value.kind is FaultKind.REFUSED

    with_two_arms(first, second, check)


@pytest.mark.parametrize("blocked", [0, 1])
def test_a_pair_with_an_unreachable_grasp_goes_home_before_another_is_chosen(blocked: int) -> None:
    scripts = (Script(), Script())
    scripts[blocked].comes_above = False

    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault, match="arms_too_near") as refused:
            await approach(task)
        assert refused.value.kind is FaultKind.REFUSED

    with_two_arms(*scripts, check)
    assert all(script.is_home for script in scripts)


def test_a_pair_that_can_neither_reach_its_grasp_nor_go_home_fails() -> None:
    first = Script()
    second = Script(comes_above=False, home_needs=first)
    first.home_needs = second

    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault) as failed:
            await approach(task)
        assert failed.value.kind is FaultKind.FAILED

    with_two_arms(first, second, check)


def test_a_pair_with_an_empty_hand_counts_as_missed() -> None:
    async def check(task: ShapeTask) -> None:
        assert not (await hands.close_fingers(task)).held

    with_two_arms(Script(), Script(holds=False), check)


@pytest.mark.parametrize(("loses", "node"), [(0, NODE), (1, PARTNERS_NODE)])
def test_a_slip_out_of_either_hand_stops_both_and_is_recorded_at_its_node(loses: int, node: int) -> None:
    scripts = (Script(), Script())
    scripts[loses].loses_at_s = 1.0

    async def check(task: ShapeTask) -> None:
        assert not await follow_while_held(task)
        assert task.attempt.slipped
        assert task.grasps.slips == {node: 1}

    with_two_arms(*scripts, check)
    assert [script.told for script in scripts] == [["follow_path", "stop"]] * 2


def test_a_held_node_may_be_off_the_tool_centre_point_along_the_rod_only() -> None:
    T_world_tcp = geometry.downward([0.5, 0.1, 0.004], 0.3)
    along, across, up = geometry.rotation(T_world_tcp).T  # axes of the tool in the world
    node = T_world_tcp.position_m + 0.012 * along + 0.004 * across + 0.002 * up

    place = place_in_tool(node, T_world_tcp)

    assert np.allclose(place, [0.012, 0.0, 0.002], atol=1e-12)


def test_a_hand_blocked_by_another_moves_after_it() -> None:
    first, second = Script(), Script()
    first.home_needs = second

    async def check(task: ShapeTask) -> None:
        await hands.go_home(task)

    with_two_arms(first, second, check)
    assert first.told == ["home", "home"]  # refused, and again once the other had gone
    assert second.told == ["home"]


def test_hands_that_block_each_other_do_not_retry_without_end() -> None:
    first, second = Script(), Script()
    first.home_needs, second.home_needs = second, first

    async def check(task: ShapeTask) -> None:
        with pytest.raises(StepFault) as failed:
            await hands.go_home(task)
        assert failed.value.reason == "arms_too_near"

    with_two_arms(first, second, check)
    assert [script.told for script in (first, second)] == [["home"]] * 2
