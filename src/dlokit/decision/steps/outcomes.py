"""How the boxes of the shape flow end."""

import enum


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
