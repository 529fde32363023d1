"""The steps that set the goal, and judge before the robot moves whether it holds and can be reached."""

from dlokit.communication import topics
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import find, find_from_scratch, settle
from dlokit.decision.steps.outcomes import Done, GoalJudged
from dlokit.decision.steps.perceive import send_robots_home, wrong_fixtures
from dlokit.decision.steps.recover import take_over
from dlokit.decision.task import ShapeTask, TaskGoal
from dlokit.geometry import rmse_m
from dlokit.skills.model import api as model
from dlokit.skills.planning import api as planning
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import Command, OperatorCommand, RunPhase

SEEN_NAME = "seen"
"""Name of a goal that the operator has shown to the camera."""
FIXTURES = "fixtures"
"""Reason why no goal is taken: a fixture does not stand as believed."""


async def set_goal(task: ShapeTask) -> Done:
    """Send the goal to the model; without a requested goal, take the operator's from the viewer."""
    request = task.request
    if request is None:
        goal = await _operators_goal(task)
    else:
        goal = await task.ask(
            model.SET_GOAL, request.nodes_world, request.name, request.ends_interchangeable, request.beside
        )
    task.goal_set = TaskGoal(shape=goal)
    await _label_ends(task)
    return Done.DONE


async def operator_starts(task: ShapeTask) -> OperatorCommand:
    """Wait for the operator's start, and look at the goals that they show meanwhile."""
    task.desk.publish(RunPhase.WAITING, notice=task.reason or "")
    async for message in task.commands:
        match message.command:
            case Command.START:
                task.desk.publish(RunPhase.RUNNING)
                return message
            case Command.SEE:
                task.desk.publish(RunPhase.LOOKING)
                task.desk.publish(RunPhase.WAITING, notice=await _notice_of_look(task))
            case _:
                pass
    raise StepFault(FaultKind.FAILED, "the bus was closed while the operator's start was awaited")


async def _notice_of_look(task: ShapeTask) -> str:
    """Take the shape that the camera sees as the goal; why it could not be taken, or empty."""
    try:
        await see_goal(task)
    except StepFault as fault:
        return f"No goal was taken: {fault}"
    return ""


async def see_goal(task: ShapeTask) -> GoalShape:
    """Take the shape that the camera sees as the goal, with the arms out of the picture.

    Raises `StepFault`, with reason `FIXTURES` before an arm moves home among fixtures that do not stand as believed.
    """
    if task.takes_over:
        await take_over(task)
        task.takes_over = False
    if task.fixtures and (wrong := await wrong_fixtures(task)):
        raise StepFault(FaultKind.FAILED, wrong, reason=FIXTURES)
    await send_robots_home(task)
    await find_from_scratch(task)
    await settle(task)
    return await _set_seen(task)


async def _set_seen(task: ShapeTask) -> GoalShape:
    return await task.ask(model.SET_GOAL, task.shape.nodes_world, SEEN_NAME)


async def _operators_goal(task: ShapeTask) -> GoalShape:
    """The goal of the operator's start command.

    Else the shape at rest into which the frames pull the rod; without frames, the goal that is set.
    """
    if task.shown:
        await settle(task)
        await _set_seen(task)
    command, task.started_by = task.started_by, None
    if command is None:
        command = await operator_starts(task)
        if task.desk.status.stays or task.shown:
            await find_from_scratch(task)  # a person may have moved the DLO meanwhile
    task.shown = False
    task.spent.started_ns = task.port.clock.now_ns()  # the operator's time does not count to the task's budget
    if command.nodes_world is not None:
        return await task.ask(model.SET_GOAL, command.nodes_world, command.goal or "goal")
    frames = task.port.latest(topics.GOAL_FRAMES).value
    if frames is not None:
        return await task.ask(model.BUILD_GOAL, frames.frames)
    goal = task.port.latest(topics.GOAL).value
    if goal is None:
        raise StepFault(FaultKind.FAILED, "no_goal: no goal is set; drag a frame, then press Shape it")
    return goal


async def _label_ends(task: ShapeTask) -> None:
    """Number the nodes from the end that is nearer to the goal's node 0, for the whole task.

    A camera cannot distinguish the ends of a rod, so the order is free; the one nearer to the goal avoids turning the
    rod around. From here on the order is kept, and a reversed goal does not count as reached unless its ends are
    interchangeable.
    """
    nodes, goal = task.shape.nodes_world, task.goal.nodes_world
    if rmse_m(nodes, goal) > rmse_m(nodes[::-1], goal):
        await task.ask(model.RESET)
        await find(task, expected_world=goal)


async def judge_goal(task: ShapeTask) -> GoalJudged:
    """Get the verdict on the goal, and treat an infeasible one as configured."""
    verdict = await task.ask(planning.JUDGE_GOAL, task.goal, task.config.threshold_m)
    task.goal_set = TaskGoal(shape=task.goal, verdict=verdict)
    task.reason = None if verdict.standing is Standing.HOLDS else f"goal {verdict.reason}: {verdict.text}"
    match verdict.standing:
        case Standing.HOLDS:
            return GoalJudged.HOLDS
        case Standing.DOUBTFUL:
            return GoalJudged.DOUBTFUL
        case Standing.INFEASIBLE:
            return await _infeasible(task, task.goal, verdict)


async def _infeasible(task: ShapeTask, asked: GoalShape, verdict: GoalVerdict) -> GoalJudged:
    if task.config.infeasible == "try":
        return GoalJudged.TRIED
    if task.config.infeasible == "project" and verdict.nearest_world is not None:
        # The requested goal is kept for the record.
        nearest = await task.ask(
            model.SET_GOAL,
            verdict.nearest_world,
            f"nearest to {asked.name}",
            asked.ends_interchangeable,
            asked.beside,
        )
        task.goal_set = TaskGoal(shape=nearest, verdict=verdict, asked=asked)
        return GoalJudged.PROJECTED
    if task.request is not None:
        return GoalJudged.REJECTED
    task.reason = f"{task.reason} Set another goal, then press Shape it again."
    return GoalJudged.ASKED_AGAIN
