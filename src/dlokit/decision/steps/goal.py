"""The box that judges the goal before the robot moves: does it hold, is it worth trying, or what holds instead?"""

from dlokit.decision.steps.outcomes import GoalJudged, fail
from dlokit.decision.task import ShapeTask
from dlokit.skills.model import api as model
from dlokit.skills.planning import api as planning
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.outcome import Succeeded


async def judge_goal(task: ShapeTask) -> GoalJudged:
    """Ask for the verdict on the goal, and do with an infeasible one what the configuration says."""
    assert task.goal is not None
    judged = await task.port.call(planning.JUDGE_GOAL, task.goal, task.config.threshold_m)
    if not isinstance(judged, Succeeded):
        fail(task, "planning.judge_goal", judged)
        return GoalJudged.FAILED
    verdict = task.verdict = judged.result
    match verdict.standing:
        case Standing.HOLDS:
            task.reason = None
            return GoalJudged.HOLDS
        case Standing.DOUBTFUL:
            task.reason = _said(verdict)
            return GoalJudged.DOUBTFUL
        case Standing.INFEASIBLE:
            return await _infeasible(task, task.goal, verdict)


async def _infeasible(task: ShapeTask, goal: GoalShape, verdict: GoalVerdict) -> GoalJudged:
    task.reason = _said(verdict)
    match task.config.infeasible:
        case "try":
            return GoalJudged.TRIED
        case "project" if verdict.nearest_world is not None:
            return await _project(task, goal, verdict)
        case _:
            pass
    if task.request is not None:
        return GoalJudged.REJECTED
    task.reason += " Drag the frames to another goal, then press Shape it again."
    return GoalJudged.ASKED_AGAIN


async def _project(task: ShapeTask, goal: GoalShape, verdict: GoalVerdict) -> GoalJudged:
    """Shape to the nearest shape that holds instead; the goal that was asked for is kept for the record."""
    assert verdict.nearest_world is not None
    projected = await task.port.call(
        model.SET_GOAL, verdict.nearest_world, f"nearest to {goal.name}", goal.ends_interchangeable
    )
    if not isinstance(projected, Succeeded):
        fail(task, "model.set_goal", projected)
        return GoalJudged.FAILED
    task.goal, task.asked = projected.result, goal
    return GoalJudged.PROJECTED


def _said(verdict: GoalVerdict) -> str:
    return f"goal {verdict.reason}: {verdict.text}"
