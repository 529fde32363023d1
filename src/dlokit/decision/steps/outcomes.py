"""How the boxes of the shape flow end, and why a skill call did not succeed, in words."""

import enum
from typing import Any

from dlokit.decision.task import ShapeTask
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Failed, Outcome, Rejected, TimedOut, Unreachable
from dlokit.types.robot import RobotReason


class Checked(enum.Enum):
    """What became of the check of the camera's place; kept: it stays as calibrated, off: it was not asked for."""

    CORRECTED = "corrected"
    KEPT = "kept"
    OFF = "off"
    FAILED = "failed"


class Sight(enum.Enum):
    """What a look gave."""

    SEEN = "seen"
    UNUSABLE = "unusable"
    LOST = "lost"
    """A component that is needed to see is gone; it is started again."""
    FAILED = "failed"


class GoalSet(enum.Enum):
    """What became of the goal."""

    SET = "set"
    LOST = "lost"
    FAILED = "failed"


class GoalJudged(enum.Enum):
    """What the model says of the goal, and what is done with one that does not hold."""

    HOLDS = "holds"
    DOUBTFUL = "doubtful"
    PROJECTED = "projected"
    TRIED = "tried"
    REJECTED = "rejected"
    ASKED_AGAIN = "asked_again"
    FAILED = "failed"


class Found(enum.Enum):
    """Whether a grasp was found."""

    FOUND = "valid"
    NONE_LEFT = "none_left"
    NO_GAIN = "no_gain"
    FAILED = "failed"


class Moved(enum.Enum):
    """What became of a motion."""

    DONE = "done"
    REFUSED = "refused"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Carried(enum.Enum):
    """What became of the carry, and whether control takes over."""

    DONE = "done"
    SLIPPED = "slipped"
    TO_CONTROL = "to_control"
    REFUSED = "refused"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Controlled(enum.Enum):
    """What control says of the DLO that is held."""

    CORRECTED = "corrected"
    SETTLED = "settled"
    DEADLOCK = "deadlock"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Grasped(enum.Enum):
    """What the fingers felt; beside: they were to hold nothing, and push."""

    HELD = "held"
    BESIDE = "beside"
    MISSED = "missed"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Released(enum.Enum):
    """What became of the release."""

    DONE = "done"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


class Change(enum.Enum):
    """Whether an action changed the error."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"


class Marked(enum.Enum):
    """Book-keeping has one outcome."""

    DONE = "done"


class Recovered(enum.Enum):
    """Whether an arm that braked by itself may go on."""

    DONE = "done"
    TOO_OFTEN = "too_often"
    FAILED = "failed"


class Restored(enum.Enum):
    """Whether a component that was lost is there again, and where to go on."""

    BEGIN = "begin"
    LOOK_AGAIN = "look_again"
    LOST = "lost"
    TOO_OFTEN = "too_often"
    FAILED = "failed"


class TakenOver(enum.Enum):
    """Whether the arm is ready for a task that is resumed."""

    DONE = "done"
    FAILED = "failed"


RESTORABLE = (perception.LOOK.component, observer.INITIALISE.component, model.SET_GOAL.component)
"""What they know can be told again, or seen: their processes may die in a task. An arm's may not."""


def explain(outcome: Outcome[Any]) -> str:
    """One line of why a call did not succeed."""
    match outcome:
        case Failed(reason=RobotReason.STOPPED, detail=detail):
            return f"stopped by {robot.STOP.key}: {detail}"
        case Failed(reason=reason, detail=detail) | Rejected(reason=reason, detail=detail):
            return f"{reason}: {detail}" if detail else reason
        case _:
            return f"{type(outcome).__name__.lower()}"


def fail(task: ShapeTask, skill: str, outcome: Outcome[Any]) -> None:
    """Keep why a skill did not succeed as the task's reason, should it end here."""
    task.reason = f"{skill} {explain(outcome)}"
    task.lost = skill.partition(".")[0] if isinstance(outcome, Unreachable | TimedOut) else ""
