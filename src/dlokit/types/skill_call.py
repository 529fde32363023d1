"""A skill call that has ended, as it is recorded."""

import enum

from dlokit.types.message import Message


class CallEnd(enum.Enum):
    """Name of a call's outcome."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    REJECTED = "rejected"
    CANCELLED = "cancelled"
    TIMED_OUT = "timed_out"
    UNREACHABLE = "unreachable"


class CallRecord(Message, frozen=True, kw_only=True, eq=False):
    """One call, with the stamp of its end."""

    skill: str
    """``component.skill``"""
    outcome: CallEnd
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
