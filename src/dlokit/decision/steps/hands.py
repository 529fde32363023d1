"""Motions of the hands of an action, of one arm or of both arms of a pair; and detection of a slip."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

import numpy as np

from dlokit.communication import topics
from dlokit.communication.container import end_tasks
from dlokit.communication.skill import Skill
from dlokit.decision.attempt import SLIPPED, ActionAttempt
from dlokit.decision.faults import reason_of, result_of
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.records import Recovery
from dlokit.decision.task import ShapeTask
from dlokit.geometry import inverse, lifted, segment_near, transform
from dlokit.skills.robot import api as robot
from dlokit.types.action import APPROACH_HEIGHT_M, Grasp, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.observation import GraspState
from dlokit.types.outcome import Failed, Outcome, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import GripResult, MotionResult, Remedy, RobotReason, remedy_of

log = logging.getLogger(__name__)

MOST_RECOVERIES = 5
"""Times in one task that the fault of an arm which braked on its own is cleared (a late heartbeat); more often is a
defect of the machine, and the task ends."""
ONCE_AN_ACTION = (RobotReason.REFLEX, RobotReason.TRACKING)
"""Stops by the arm itself, perhaps after a contact: recovered once per action. A second stop needs a person."""

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class ArmAction:
    """The part of an action that one arm executes."""

    robot: str
    grasp: Grasp
    path: tuple[Pose, ...]
    velocity: VelocityProfile
    instance: str
    """Address of the arm, for `Skill.at` and `Topic.at`."""


def arm_actions_of(task: ShapeTask) -> tuple[ArmAction, ...]:
    """The hands that the current action needs, the first arm's first.

    Raises `StepFault` when a planner names an arm that the run does not have.
    """
    action = task.attempt.action
    parts = (action,) if action.partner is None else (action, action.partner)
    instances = dict(zip(task.robots, task.instances, strict=True))
    if unknown := [one.robot for one in parts if one.robot not in instances]:
        known = ", ".join(task.robots)
        raise StepFault(FaultKind.FAILED, f"the action is for the arm {unknown[0]!r}; this run has {known}")
    return tuple(ArmAction(one.robot, one.grasp, one.path, one.velocity, instances[one.robot]) for one in parts)


async def refused(motion: Awaitable[object]) -> StepFault | None:
    """The fault of a motion that the robot refuses; None if it moves. Raises `StepFault` for every other fault."""
    try:
        await motion
    except StepFault as fault:
        if fault.kind is not FaultKind.REFUSED:
            raise
        return fault
    return None


async def open_fingers(task: ShapeTask) -> None:
    """Open all hands at once, each to the width of its grasp. Raises `StepFault`, as all functions here do."""
    opened = await _all_at_once(
        task, lambda hand: task.port.call(robot.RELEASE.at(hand.instance), hand.grasp.opening_m)
    )
    result_of(robot.RELEASE, opened)


async def go_above(task: ShapeTask) -> None:
    """Move above the grasps in joint space."""
    moved = await _one_by_one(
        task,
        lambda hand: task.port.call(robot.MOVE_TO.at(hand.instance), lifted(hand.grasp.T_world_tcp, APPROACH_HEIGHT_M)),
    )
    result_of(robot.MOVE_TO, moved)


async def go_down(task: ShapeTask) -> None:
    """Move straight down to the grasps."""
    moved = await together(
        task,
        lambda hand: task.port.call(robot.MOVE_LINEAR.at(hand.instance), hand.grasp.T_world_tcp, hand.velocity),
    )
    result_of(robot.MOVE_LINEAR, moved)


async def close_fingers(task: ShapeTask) -> GripResult:
    """Close all hands; return the result of a hand that holds nothing, if any."""
    force_n = task.config.grasp_force_n
    gripped = await asyncio.gather(
        *(task.port.call(robot.GRASP.at(hand.instance), force_n) for hand in arm_actions_of(task))
    )
    worst = next((one for one in gripped if not (isinstance(one, Succeeded) and one.result.held)), gripped[0])
    return result_of(robot.GRASP, worst)


async def follow_paths(task: ShapeTask) -> None:
    """Follow the paths of the action, all arms at once."""
    result_of(robot.FOLLOW_PATH, await _follow(task))


async def _follow(task: ShapeTask, *, interrupted: bool = False) -> Outcome[MotionResult]:
    def follow(hand: ArmAction) -> Coroutine[Any, Any, Outcome[MotionResult]]:
        path = _rest_of_path(task, hand) if interrupted else hand.path
        return task.port.call(robot.FOLLOW_PATH.at(hand.instance), path, hand.velocity)

    return await together(task, follow)


def _rest_of_path(task: ShapeTask, hand: ArmAction) -> tuple[Pose, ...]:
    """The poses of a hand's path that its tool, stopped somewhere on the path, has not reached."""
    state = task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value
    if state is None:
        return hand.path
    corners = np.array([pose.position_m for pose in (hand.grasp.T_world_tcp, *hand.path)])
    return hand.path[segment_near(corners, state.T_world_tcp.position_m) :]


async def go_up(task: ShapeTask) -> None:
    """Move straight up from the present poses."""

    def up(hand: ArmAction) -> Coroutine[Any, Any, Outcome[MotionResult]]:
        state = task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value
        start = hand.path[-1] if state is None else state.T_world_tcp
        target = lifted(start, APPROACH_HEIGHT_M)
        return task.port.call(robot.MOVE_LINEAR.at(hand.instance), target, hand.velocity)

    result_of(robot.MOVE_LINEAR, await together(task, up))


async def go_home(task: ShapeTask) -> None:
    """Move home, out of the picture."""
    home = await _one_by_one(task, lambda hand: task.port.call(robot.HOME.at(hand.instance)))
    result_of(robot.HOME, home)


def may_recover(task: ShapeTask, reason: str) -> bool:
    """Whether an arm that stopped on its own for this reason may be recovered without a person."""
    done = task.spent.recoveries
    if reason in ONCE_AN_ACTION and any(
        one.action == task.actions + 1 and one.reason in ONCE_AN_ACTION for one in done
    ):
        return False
    return len(done) < MOST_RECOVERIES


def note_recovery(task: ShapeTask, reason: str) -> None:
    """Count a recovery, for the limits and the result."""
    log.warning("an arm stopped on its own (%s) and is recovered", reason)
    task.spent.recoveries.append(Recovery(action=task.actions + 1, reason=reason))


async def clear_faults(task: ShapeTask) -> None:
    """Clear the faults of arms that braked on their own."""
    cleared = await _one_by_one(task, lambda hand: task.port.call(robot.RECOVER.at(hand.instance)))
    result_of(robot.RECOVER, cleared)


_BRAKED_S = 0.3
"""Wait after an arm has braked on its own [s]: by then it is at rest, and the late heartbeat has arrived."""


async def until_done(task: ShapeTask, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
    """Move an arm that holds nothing; repeat the motion after the arm braked on its own, a bounded number of times.

    The flow's step `recover` must choose a new action because a DLO may be held; here the same motion is repeated.
    Each repetition counts to the limits of `may_recover`. Returns the outcome of the last call.
    """
    while True:
        moved = await task.port.call(skill, *args, **kwargs)
        if remedy_of(reason_of(moved)) is not Remedy.RECOVER or not may_recover(task, reason_of(moved)):
            return moved
        note_recovery(task, reason_of(moved))
        await task.port.clock.sleep(_BRAKED_S)
        recovered = await task.port.call(robot.RECOVER.at(skill.component.partition(".")[2]))
        if not isinstance(recovered, Succeeded):
            return recovered


async def together(task: ShapeTask, call: Callable[[ArmAction], Coroutine[Any, Any, Outcome[R]]]) -> Outcome[R]:
    """Move all hands at once; when one does not succeed, stop the rest and return its outcome."""
    hands = arm_actions_of(task)
    running = [asyncio.ensure_future(call(hand)) for hand in hands]
    failed: Outcome[R] | None = None
    waiting = set(running)
    try:
        while waiting:
            _, waiting = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            if failed is not None:
                continue
            # In the order of the hands, not of the set, so that runs are repeatable.
            ended = [one.result() for one in running if one not in waiting]
            failed = next((outcome for outcome in ended if not isinstance(outcome, Succeeded)), None)
            if failed is not None:
                await stop(task, [hand for hand, one in zip(hands, running, strict=True) if one in waiting])
        return failed or running[0].result()
    finally:
        await end_tasks(*running)


async def stop(task: ShapeTask, hands: list[ArmAction] | None = None) -> None:
    """Brake the arms of these hands, or of all hands of the action."""
    for hand in arm_actions_of(task) if hands is None else hands:
        await task.port.call(robot.HALT.at(hand.instance))


async def _one_by_one(task: ShapeTask, call: Callable[[ArmAction], Coroutine[Any, Any, Outcome[R]]]) -> Outcome[R]:
    """Move one hand after the other, so that each plans while the rest are still; a blocked hand is tried again later.

    Returns at the first failure for another reason, or when all remaining hands block one another.
    """
    waiting = arm_actions_of(task)
    while True:
        blocked: list[ArmAction] = []
        outcomes: list[Outcome[R]] = []
        for hand in waiting:
            outcome = await call(hand)
            match outcome:
                case Succeeded():
                    pass
                case Failed(reason=RobotReason.ARMS_TOO_NEAR):
                    blocked.append(hand)
                case _:
                    return outcome
            outcomes.append(outcome)
        if len(blocked) in (0, len(waiting)):
            return outcomes[0]
        waiting = tuple(blocked)


async def _all_at_once(task: ShapeTask, call: Callable[[ArmAction], Coroutine[Any, Any, Outcome[R]]]) -> Outcome[R]:
    """Call for all hands at once, regardless of failures; return the first outcome that is not a success."""
    outcomes = await asyncio.gather(*(call(hand) for hand in arm_actions_of(task)))
    return next((outcome for outcome in outcomes if not isinstance(outcome, Succeeded)), outcomes[0])


def publish_gripped(task: ShapeTask, *, held: bool) -> None:
    """Publish the held nodes and their place between the fingers, or that no node is held."""
    for hand in arm_actions_of(task):
        tool = task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value
        node, place = hand.grasp.node if held else None, None
        if held and tool is not None and task.state is not None:
            place = place_in_tool(task.state.nodes_world[hand.grasp.node], tool.T_world_tcp)
        message = GraspState(stamp_ns=task.port.clock.now_ns(), robot=hand.robot, node=node, node_tcp=place)
        task.port.publish(topics.GRIPPED, message)


def place_in_tool(node_world: Float64Array, T_world_tcp: Pose) -> Float64Array:
    """Position of a grasped node (3,) [m] in the tool's frame: the closed fingers have centred it between them.

    Along the fingers and along the rod it keeps its position; a grasp need not be at a node.
    """
    place = transform(inverse(T_world_tcp), node_world[None, :])[0]
    place[1] = 0.0
    return place


_STILL_M = 0.008  # a DLO whose nodes all moved by less than this counts as not moved: the accuracy of the camera
_MOVED_M = 0.03  # a carry shorter than this need not move the DLO visibly


def still_carry(task: ShapeTask) -> bool:
    """Whether an interrupted carry can go on: all fingers feel the DLO, and no arm stopped because it may have touched
    something."""
    if not task.attempt.carrying or task.fault in ONCE_AN_ACTION:
        return False
    states = [task.port.latest(topics.ROBOT_STATE.at(hand.instance)).value for hand in arm_actions_of(task)]
    return all(state is not None and state.holding for state in states)


async def follow_while_held(task: ShapeTask, *, interrupted: bool = False) -> bool:
    """Follow the paths of the action, `interrupted` ones from the tools' present poses; return whether the DLO was
    held to their end.

    Where the fingers of a hand close on nothing, stop all arms and note the slip.
    """
    follow = asyncio.ensure_future(_follow(task, interrupted=interrupted))
    watches = {
        asyncio.create_task(_fingers_close(task, hand), name=f"slip {hand.robot}"): hand
        for hand in arm_actions_of(task)
    }
    try:
        await asyncio.wait((follow, *watches), return_when=asyncio.FIRST_COMPLETED)
        lost = [hand for watch, hand in watches.items() if watch.done()]
        if lost and not follow.done():
            for hand in lost:
                note_slip(task, hand.grasp.node)
            await stop(task)
        moved = await follow
    finally:
        await end_tasks(follow, *watches)
    if task.attempt.slipped:
        return False
    result_of(robot.FOLLOW_PATH, moved)
    return True


async def _fingers_close(task: ShapeTask, hand: ArmAction) -> None:
    """Return when fingers that held something hold nothing; never, for a robot without that sensor."""
    held = False
    async for state in task.port.stream(topics.ROBOT_STATE.at(hand.instance)):
        if held and not state.holding:
            return
        held = held or state.holding
    await asyncio.Event().wait()  # the stream has ended: no slip can be detected any more


def note_slip(task: ShapeTask, node: int) -> None:
    """Note that the current action has lost the DLO at a node; after two slips the node is not grasped again."""
    task.attempt.ends_early(SLIPPED)
    task.grasps.slipped(node)


def stayed_behind(attempt: ActionAttempt, after_world: Float64Array) -> bool:
    """Whether the tool moved away and the DLO, now at `after_world` (M, 3) [m], did not follow it.

    False for a carry that ended before its planned end: it is not known how far the tool moved.
    """
    if not attempt.grasp_ok or attempt.ended_by:
        return False
    action = attempt.action
    carry_m = np.linalg.norm(action.path[-1].position_m[:2] - action.grasp.T_world_tcp.position_m[:2])
    moved_m = np.linalg.norm((after_world - attempt.before_world)[:, :2], axis=1).max()
    return bool(carry_m > _MOVED_M and moved_m < _STILL_M)
