"""Both arms of a pair: what the boxes do when an action has a partner."""

import asyncio
from collections.abc import Coroutine
from dataclasses import dataclass
from typing import Any, TypeVar

from dlokit.communication import topics
from dlokit.decision.task import ShapeTask
from dlokit.description.arms import instance_of
from dlokit.geometry import inverse, matrix, pose_from_matrix, transform
from dlokit.skills.robot import api as robot
from dlokit.types.action import Action, Grasp, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.observation import Gripped
from dlokit.types.outcome import Outcome, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, MotionResult

R = TypeVar("R")


@dataclass(frozen=True)
class Hand:
    """What one arm does of an action."""

    robot: str
    grasp: Grasp
    path: tuple[Pose, ...]
    velocity: VelocityProfile

    @property
    def instance(self) -> str:
        """For `Skill.at` and `Topic.at`."""
        return instance_of(self.robot)


def hands_of(action: Action) -> tuple[Hand, ...]:
    """The hands that an action needs, the first arm's first."""
    own = Hand(action.robot, action.grasp, action.path, action.velocity)
    other = action.partner
    if other is None:
        return (own,)
    return (own, Hand(other.robot, other.grasp, other.path, other.velocity))


def above(pose: Pose, height_m: float) -> Pose:
    """The pose, higher."""
    T = matrix(pose)
    T[2, 3] += height_m
    return pose_from_matrix(T)


async def approach_one_by_one(task: ShapeTask) -> Outcome[Any]:
    """Open the fingers and go above the grasp, one arm after the other: the second sees where the first stands."""
    outcome: Outcome[Any] = Succeeded(result=None)
    for hand in hands_of(task.chosen):
        outcome = await task.port.call(robot.RELEASE.at(hand.instance), hand.grasp.opening_m)
        if isinstance(outcome, Succeeded):
            target = above(hand.grasp.T_world_tcp, task.config.approach_height_m)
            outcome = await task.port.call(robot.MOVE_TO.at(hand.instance), target)
        if not isinstance(outcome, Succeeded):
            return outcome
    return outcome


async def down_together(task: ShapeTask) -> Outcome[MotionResult]:
    """Straight down with both."""
    return await together(
        task,
        *(
            task.port.call(robot.MOVE_LINEAR.at(hand.instance), hand.grasp.T_world_tcp, hand.velocity)
            for hand in hands_of(task.chosen)
        ),
    )


async def grasp_together(task: ShapeTask) -> Outcome[GripResult]:
    """Close both; the outcome of the one that holds nothing, where there is one."""
    force_n = task.config.grasp_force_n
    gripped = await asyncio.gather(
        *(task.port.call(robot.GRASP.at(hand.instance), force_n) for hand in hands_of(task.chosen))
    )
    return next((one for one in gripped if not (isinstance(one, Succeeded) and one.result.held)), gripped[0])


async def carry_together(task: ShapeTask) -> Outcome[MotionResult]:
    """Both paths at the same time."""
    return await together(
        task,
        *(
            task.port.call(robot.FOLLOW_PATH.at(hand.instance), hand.path, hand.velocity)
            for hand in hands_of(task.chosen)
        ),
    )


async def let_go(task: ShapeTask) -> Outcome[Any]:
    """Open both hands at once."""
    opened = await asyncio.gather(
        *(task.port.call(robot.RELEASE.at(hand.instance), hand.grasp.opening_m) for hand in hands_of(task.chosen))
    )
    return next((one for one in opened if not isinstance(one, Succeeded)), opened[0])


async def up_together(task: ShapeTask) -> Outcome[MotionResult]:
    """Straight up with both, from wherever they are."""
    calls: list[Coroutine[Any, Any, Outcome[MotionResult]]] = []
    for hand in hands_of(task.chosen):
        state = task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value
        start = hand.path[-1] if state is None else state.T_world_tcp
        target = above(start, task.config.retreat_height_m)
        calls.append(task.port.call(robot.MOVE_LINEAR.at(hand.instance), target, hand.velocity))
    return await together(task, *calls)


async def home_one_by_one(task: ShapeTask) -> Outcome[Any]:
    """Both out of the picture."""
    outcome: Outcome[Any] = Succeeded(result=None)
    for hand in hands_of(task.chosen):
        outcome = await task.port.call(robot.HOME.at(hand.instance))
        if not isinstance(outcome, Succeeded):
            return outcome
    return outcome


async def together(task: ShapeTask, *calls: Coroutine[Any, Any, Outcome[R]]) -> Outcome[R]:
    """Calls to both hands at once; when one does not succeed the other is stopped, and its outcome is the outcome."""
    running = [asyncio.ensure_future(call) for call in calls]
    failed: Outcome[R] | None = None
    try:
        for next_done in asyncio.as_completed(running):
            outcome = await next_done
            if failed is None and not isinstance(outcome, Succeeded):
                failed = outcome
                for hand in hands_of(task.chosen):
                    await task.port.call(robot.STOP.at(hand.instance))
        return failed or await running[0]
    finally:
        for waiting in running:
            waiting.cancel()
        await asyncio.gather(*running, return_exceptions=True)


def say_gripped(task: ShapeTask, *, held: bool) -> None:
    """Tell everybody which nodes are held and where in the fingers, or that none is."""
    for hand in hands_of(task.chosen):
        tool = task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value
        node, place = hand.grasp.node if held else None, None
        if held and tool is not None and task.state is not None:
            place = place_in_tool(task.state.nodes_world[hand.grasp.node], tool.T_world_tcp)
        message = Gripped(stamp_ns=task.port.clock.now_ns(), robot=hand.robot, node=node, node_tcp=place)
        task.port.publish(topics.GRIPPED, message)


def place_in_tool(node_world: Float64Array, T_world_tcp: Pose) -> Float64Array:
    """Where a grasped node (3,) [m] is in the tool's frame: closed fingers have brought it to the middle between them.

    Along the fingers and along the rod it stays where it was; a grasp need not be at a node.
    """
    place = transform(inverse(T_world_tcp), node_world[None, :])[0]
    place[1] = 0.0
    return place
