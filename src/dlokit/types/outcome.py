"""What became of a skill call, and how calls are recorded."""

import enum
from typing import Generic, TypeVar

from dlokit.types.message import Message, Value

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


class CallEnd(enum.Enum):
    """Name of a call's outcome."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    REJECTED = "rejected"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed_out"
    UNREACHABLE = "unreachable"


class CallBegun(Message, frozen=True, kw_only=True, eq=False):
    """A call was made. One that has no end in a recording ran when the recording ended."""

    skill: str
    """``component.skill``"""
    call: int
    """Its number among those of its caller, from 1."""
    caller: str = ""
    """Who called, as the bus knows it."""


class CallRecord(Message, frozen=True, kw_only=True, eq=False):
    """One call, with the stamp of its end."""

    skill: str
    """``component.skill``"""
    outcome: CallEnd
    call: int = 0
    """Its number among those of its caller, from 1: the one with which it was told to have begun."""
    caller: str = ""
    """Who called, as the bus knows it."""
    reason: str = ""
    """Of a call that failed or was rejected."""
    detail: str = ""
    """For people."""
    began_ns: int = 0
    """When it was called [ns], on the clock of the stamp."""
    arguments: str = "{}"
    """As a JSON object; empty when there would be too much of it."""
    result: str = ""
    """As JSON; empty when it did not succeed, or would be too much."""
