"""Outcomes of skill calls, which explain and unwrap themselves, and the messages that record calls."""

import enum
from typing import ClassVar, Generic, NoReturn, TypeVar

from dlokit.errors import SkillFailure, SkillRejected
from dlokit.types.message import Message, Value

R = TypeVar("R")


class CallEnd(enum.Enum):
    """Name of a call's outcome."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    REJECTED = "rejected"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed_out"
    UNREACHABLE = "unreachable"


class _AnyOutcome(Value, frozen=True, kw_only=True, eq=False):
    """Common to all outcomes."""

    end: ClassVar[CallEnd]
    """Name of the outcome."""

    @property
    def named_reason(self) -> str:
        """The reason by its name in the skill's api; empty if the skill named none."""
        return ""

    @property
    def why(self) -> str:
        """Why the call did not succeed; empty if the outcome's name says it all."""
        return ""

    def __str__(self) -> str:
        """One line, e.g. ``failed no_points: the cloud is empty``."""
        between = " " if self.named_reason else ": "
        return self.end.value.replace("_", " ") + (f"{between}{self.why}" if self.why else "")


class Succeeded(_AnyOutcome, Generic[R], frozen=True, kw_only=True, eq=False, tag=True):
    """The call was sent, received and executed (the paper's ``success``); contains the skill's result."""

    end = CallEnd.SUCCEEDED
    result: R

    def unwrap(self, asked: str = "") -> R:
        """The result."""
        return self.result


class _WithoutResult(_AnyOutcome, frozen=True, kw_only=True, eq=False):
    """Common to outcomes without a result."""

    def unwrap(self, asked: str = "") -> NoReturn:
        """Raise `SkillRejected` if the skill did not start, else `SkillFailure`.

        `asked` names what was called, as the subject of the error's detail.
        """
        reason = self.named_reason or self.end.value
        raise (SkillRejected if self.end is CallEnd.REJECTED else SkillFailure)(reason, self._detail_of(asked))

    def _detail_of(self, asked: str) -> str:
        detail = self.why or f"it was {self.end.value}"
        return f"{asked}: {detail}" if asked else detail


class _WithReason(_WithoutResult, frozen=True, kw_only=True, eq=False):
    """Common to outcomes for which the skill names a reason."""

    reason: str
    """Short name, e.g. ``"no_points"``; the skill's api lists its names."""
    detail: str = ""

    @property
    def named_reason(self) -> str:
        """The reason by its name."""
        return self.reason

    @property
    def why(self) -> str:
        """Reason and detail."""
        return f"{self.reason}: {self.detail}" if self.detail else self.reason

    def _detail_of(self, asked: str) -> str:
        return f"{asked} {self.end.value}: {self.detail}" if asked else self.detail


class Failed(_WithReason, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill ran and did not succeed."""

    end = CallEnd.FAILED


class Rejected(_WithReason, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill did not start: a precondition does not hold, or the arguments do not fit."""

    end = CallEnd.REJECTED


class Cancelled(_WithoutResult, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill was cancelled before its end and left the robot in a safe state."""

    end = CallEnd.CANCELLED


class TimedOut(_WithoutResult, frozen=True, kw_only=True, eq=False, tag=True):
    """The skill exceeded the time-out in its declaration and was cancelled."""

    end = CallEnd.TIMED_OUT
    timeout_s: float

    @property
    def why(self) -> str:
        """The time-out that was exceeded."""
        return f"it had not ended after {self.timeout_s:g} s and was cancelled"


class Unreachable(_WithoutResult, frozen=True, kw_only=True, eq=False, tag=True):
    """No process answered: the component is not running."""

    end = CallEnd.UNREACHABLE
    component: str

    @property
    def why(self) -> str:
        """The component that did not answer."""
        return f"{self.component} does not answer; it is not running"


Outcome = Succeeded[R] | Failed | Rejected | Cancelled | TimedOut | Unreachable


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
