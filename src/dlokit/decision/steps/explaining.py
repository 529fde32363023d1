"""Why a skill call did not succeed, in words."""

from typing import Any

from dlokit.decision.task import ShapeTask
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Failed, Outcome, Rejected, TimedOut, Unreachable

RESTORABLE = (perception.LOOK.component, observer.INITIALISE.component, model.SET_GOAL.component)
"""What they know can be told again, or seen: their processes may die in a task. An arm's may not."""


def explain(outcome: Outcome[Any]) -> str:
    """One line of why a call did not succeed."""
    match outcome:
        case Failed(reason="stopped", detail=detail):
            return f"stopped by {robot.STOP.key}: {detail}"
        case Failed(reason=reason, detail=detail) | Rejected(reason=reason, detail=detail):
            return f"{reason}: {detail}" if detail else reason
        case _:
            return f"{type(outcome).__name__.lower()}"


def fail(task: ShapeTask, skill: str, outcome: Outcome[Any]) -> None:
    """Keep why a skill did not succeed as the task's reason, should it end here."""
    task.reason = f"{skill} {explain(outcome)}"
    task.lost = skill.partition(".")[0] if isinstance(outcome, Unreachable | TimedOut) else ""
