"""Maps the outcome of a skill call that did not succeed to an arrow of the chart; no other module does."""

from typing import Any, TypeVar

from dlokit.communication.skill import Skill
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Failed, Outcome, Rejected, Succeeded, TimedOut, Unreachable
from dlokit.types.robot import Remedy, RobotReason, remedy_of

R = TypeVar("R")

_KINDS = {
    Remedy.ANOTHER_TARGET: FaultKind.REFUSED,
    Remedy.RECOVER: FaultKind.INTERRUPTED,
    Remedy.NONE: FaultKind.FAILED,
}

BY_A_PERSON = frozenset({RobotReason.STOPPED, RobotReason.STOP_LATCHED})
"""Failures of a motion that a person's stop of the arm has ended, or not let begin."""

RESTORABLE = (perception.LOOK.component, observer.INITIALISE.component, model.SET_GOAL.component)
"""Components whose state can be sent again or observed: their processes may die in a task. An arm's may not."""


def result_of(skill: Skill[..., R], outcome: Outcome[R]) -> R:
    """The result of a call. Raises `StepFault` when it did not succeed."""
    if isinstance(outcome, Succeeded):
        return outcome.result
    raise StepFault(_fault(skill, outcome), explain(outcome), skill=skill.key, reason=reason_of(outcome))


def _fault(skill: Skill[..., Any], outcome: Outcome[Any]) -> FaultKind:
    if isinstance(outcome, Unreachable | TimedOut) and skill.component in RESTORABLE:
        return FaultKind.LOST
    if skill.component == perception.LOOK.component and reason_of(outcome) in perception.MAY_RETURN:
        return FaultKind.LOST  # waited for like a component that is gone: no motion is planned before it is back
    return _KINDS[remedy_of(reason_of(outcome))]


def reason_of(outcome: Outcome[Any]) -> str:
    """The failure's name in the skill's api; empty if the call succeeded or no component answered."""
    return outcome.reason if isinstance(outcome, Failed | Rejected) else ""


def explain(outcome: Outcome[Any]) -> str:
    """One line that explains why a call did not succeed."""
    match outcome:
        case Failed(reason=RobotReason.STOPPED, detail=detail) if detail.startswith("by "):
            return f"stopped {detail}"  # the arm names the process of the person who stopped it
        case Failed(reason=RobotReason.STOPPED, detail=detail):
            return f"stopped by {robot.STOP.key}: {detail}"
        case Failed(reason=reason, detail=detail) | Rejected(reason=reason, detail=detail):
            return f"{reason}: {detail}" if detail else reason
        case _:
            return f"{type(outcome).__name__.lower()}"
