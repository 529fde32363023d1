"""How the boxes of the shape flow end when the skills that they call succeed."""

import enum


class Done(enum.Enum):
    """Of a box that has one way to end."""

    DONE = "done"


class Checked(enum.Enum):
    """What became of the check of the camera's place; kept: it stays as calibrated, off: it was not asked for."""

    CORRECTED = "corrected"
    KEPT = "kept"
    OFF = "off"


class Sight(enum.Enum):
    """Whether the task can work with what was seen."""

    SEEN = "seen"
    UNUSABLE = "unusable"


class GoalJudged(enum.Enum):
    """What the model says of the goal, and what is done with one that does not hold."""

    HOLDS = "holds"
    DOUBTFUL = "doubtful"
    PROJECTED = "projected"
    TRIED = "tried"
    REJECTED = "rejected"
    ASKED_AGAIN = "asked_again"


class Found(enum.Enum):
    """Whether a grasp was found."""

    FOUND = "valid"
    NONE_LEFT = "none_left"
    NO_GAIN = "no_gain"


class Grasped(enum.Enum):
    """What the fingers felt; beside: they were to hold nothing, and push."""

    HELD = "held"
    BESIDE = "beside"
    MISSED = "missed"


class Carried(enum.Enum):
    """What became of the carry, and whether control takes over."""

    DONE = "done"
    SLIPPED = "slipped"
    TO_CONTROL = "to_control"


class Controlled(enum.Enum):
    """What control says of the DLO that is held."""

    CORRECTED = "corrected"
    SETTLED = "settled"
    DEADLOCK = "deadlock"


class Change(enum.Enum):
    """Whether an action changed the error."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"


class Recovered(enum.Enum):
    """Whether an arm that braked by itself may go on."""

    DONE = "done"
    TOO_OFTEN = "too_often"


class Restored(enum.Enum):
    """Whether a component that was lost is there again, and where to go on."""

    BEGIN = "begin"
    LOOK_AGAIN = "look_again"
    TOO_OFTEN = "too_often"
