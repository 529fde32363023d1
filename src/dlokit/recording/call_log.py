"""Records each skill call that is made through a transport as messages."""

from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from dlokit.communication.calls import CallEnded
from dlokit.communication.skill import Skill
from dlokit.communication.topic import Topic
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.recording.channels import CALLS_BEGUN, SKILL_CALLS
from dlokit.recording.message_json import to_json
from dlokit.types.message import Message
from dlokit.types.outcome import (
    CallBegun,
    CallEnd,
    CallRecord,
    Failed,
    Outcome,
    Rejected,
    Succeeded,
)

LARGEST_TEXT = 65_536
"""Longer arguments and results are omitted [bytes]; the shapes in them are also published on topics."""


class CallLog:
    """Records one message at the start and one at the end of each call; cancellation is also an end."""

    def __init__(
        self,
        now_ns: Callable[[], int],
        put: Callable[[Topic[Any], Message | Callable[[], Message]], None],
        *,
        unlogged: frozenset[str] = frozenset(),
    ) -> None:
        """`now_ns` is the run's clock; calls to the components in `unlogged` are not recorded.

        `put` takes each message with its topic, or a function that returns the message and may run on another thread:
        writing arguments and a result as JSON takes longer than most calls.
        """
        self._now_ns = now_ns
        self._put = put
        self._unlogged = unlogged
        self._begun = 0
        self._ended = 0

    def begin(self, skill: Skill[..., Any], caller: str) -> CallEnded | None:
        """Implements `dlokit.communication.calls.CallListener`."""
        if skill.component in self._unlogged:
            return None
        began_ns = self._now_ns()
        self._begun += 1
        number = self._begun
        self._put(CALLS_BEGUN, CallBegun(stamp_ns=began_ns, seq=number, skill=skill.key, call=number, caller=caller))

        def end(outcome: Outcome[Any], arguments: bytes) -> None:
            self._ended += 1
            bare = CallRecord(
                stamp_ns=self._now_ns(),
                seq=self._ended,
                skill=skill.key,
                call=number,
                caller=caller,
                outcome=CallEnd.CANCELLED,
                began_ns=began_ns,
            )
            self._put(SKILL_CALLS, partial(record_of, bare, outcome, arguments))

        return end


def record_of(bare: CallRecord, outcome: Outcome[Any], arguments: bytes) -> CallRecord:
    """Complete a call's record with its outcome, and with arguments and result as JSON."""
    return msgspec.structs.replace(
        bare,
        outcome=outcome.end,
        reason=outcome.named_reason,
        detail=outcome.detail if isinstance(outcome, Failed | Rejected) else outcome.why,
        arguments=_arguments(arguments),
        result=_text(outcome.result) if isinstance(outcome, Succeeded) else "",
    )


def _arguments(encoded: bytes) -> str:
    try:
        # Decoded without the skill's types, so that the record contains exactly the sent data.
        named = codec.decode(encoded, dict[str, Any])
    except CommunicationError:
        return ""  # they did not fit the signature, as the outcome reports, or are too long
    parts = {name: _text(value) for name, value in named.items()}
    text = "{" + ", ".join(f'"{name}": {value or "null"}' for name, value in parts.items()) + "}"
    return text if len(text) <= LARGEST_TEXT else ""


def _text(value: object) -> str:
    data = to_json(value)
    return data.decode() if len(data) <= LARGEST_TEXT else ""
