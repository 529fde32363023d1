"""Outcomes of skill calls, and the messages that record calls."""

import enum
from typing import Generic, TypeVar

from dlokit.types.message import Message, Value

R = TypeVar("R")


class Succeeded(Value, Generic[R], frozen=True, kw_only=True, eq=False, tag=True):
    """The call was sent, received and executed (the paper's ``success``); contains the skill's result."""

    result: R


class Failed(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill ran and did not succeed."""

    reason: str
    """Short name, e.g. ``"no_points"``; the skill's api lists its names."""
    detail: str = ""


class Rejected(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill did not start: a precondition does not hold, or the arguments do not fit."""

    reason: str
    detail: str = ""


class Cancelled(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill was cancelled before its end and left the robot in a safe state."""


class TimedOut(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill exceeded the time-out in its declaration and was cancelled."""

    timeout_s: float


class Unreachable(Value, frozen=True, kw_only=True, eq=False, tag=True):
    """No process answered: the component is not running."""

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
    """Start of a call. A call without an end in a recording was running when the recording ended."""

    skill: str
    """``component.skill``"""
    call: int
    """Number of the call, counted from 1 for each caller."""
    caller: str = ""
    """Identity of the caller on the bus."""


class CallRecord(Message, frozen=True, kw_only=True, eq=False):
    """A completed call; its stamp is the end of the call."""

    skill: str
    """``component.skill``"""
    outcome: CallEnd
    call: int = 0
    """Number of the call, counted from 1 for each caller; the same as in its `CallBegun`."""
    caller: str = ""
    """Identity of the caller on the bus."""
    reason: str = ""
    """Reason of a call that failed or was rejected."""
    detail: str = ""
    """Explanation for the user."""
    began_ns: int = 0
    """Start of the call [ns], on the clock of the stamp."""
    arguments: str = "{}"
    """Arguments as a JSON object; empty if too long."""
    result: str = ""
    """Result as JSON; empty if the call did not succeed or the result is too long."""
