"""Outcomes of the steps of the shape flow when the skills that they call succeed."""

import enum


class Done(enum.Enum):
    """Outcome of a step that has only one."""

    DONE = "done"


class Checked(enum.Enum):
    """Result of the camera check; kept: the calibration stays as it is, off: no check was configured."""

    CORRECTED = "corrected"
    KEPT = "kept"
    OFF = "off"


class FixturesSeen(enum.Enum):
    """Whether all fixtures that can be seen stand as believed, and nothing else does."""

    AS_BELIEVED = "as_believed"
    OTHERWISE = "otherwise"


class Sight(enum.Enum):
    """Whether the observed shape can be used."""

    SEEN = "seen"
    UNUSABLE = "unusable"


class GoalJudged(enum.Enum):
    """The verdict on the goal, and the treatment of a goal that does not hold."""

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
    """Result of the finger feedback; beside: the fingers are closed beside the DLO, to push it."""

    HELD = "held"
    BESIDE = "beside"
    MISSED = "missed"


class Carried(enum.Enum):
    """How the carry ended, and whether control follows."""

    DONE = "done"
    SLIPPED = "slipped"
    TO_CONTROL = "to_control"


class Controlled(enum.Enum):
    """Result of one round of control on the held DLO."""

    CORRECTED = "corrected"
    SETTLED = "settled"
    DEADLOCK = "deadlock"


class Change(enum.Enum):
    """Whether an action changed the error."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"


class Recovered(enum.Enum):
    """Whether an arm that braked on its own may go on; carrying: its fingers still hold the DLO in the middle of a
    carry."""

    DONE = "done"
    CARRYING = "carrying"
    TOO_OFTEN = "too_often"


class Restored(enum.Enum):
    """Whether a lost component is alive again, and where the flow continues."""

    BEGIN = "begin"
    LOOK_AGAIN = "look_again"
    TOO_OFTEN = "too_often"
