"""Skill calls as they are recorded: that one has begun, and how it ended."""

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
