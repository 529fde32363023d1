"""What became of a skill call."""

from typing import Generic, TypeVar

from dlokit.types.message import Value

R = TypeVar("R")


class Succeeded(Value, Generic[R], frozen=True, kw_only=True, eq=False, tag=True):
    """Sent, received, executed (the paper's ``success``), with the skill's result."""

    result: R


class Failed(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill ran and did not reach its end."""

    reason: str
    """A short name, e.g. ``"no_points"``; the skill's api lists the names it uses."""
    detail: str = ""


class Rejected(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill did not start: a precondition does not hold, or the arguments do not fit."""

    reason: str
    detail: str = ""


class Cancelled(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill was stopped before its end, and left the robot safe."""


class TimedOut(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill did not answer in the time its declaration allows; it was cancelled."""

    timeout_s: float


class Unreachable(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """Nobody answered: the component is not running."""

    component: str


Outcome = Succeeded[R] | Failed | Rejected | Cancelled | TimedOut | Unreachable
