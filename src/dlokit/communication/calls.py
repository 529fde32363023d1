"""The caller's side of a skill call, the same on every transport (Algorithm 1)."""

import itertools
import logging
from collections.abc import Callable
from typing import Any, ParamSpec, Protocol, TypeVar

from dlokit.communication.skill import SCHEMA_MISMATCH, ReportingSkill, Skill, SkillCall
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.outcome import Cancelled, Failed, Outcome, Rejected, TimedOut, Unreachable

P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

log = logging.getLogger(__name__)

CallEnded = Callable[[Outcome[Any], bytes], None]
"""Takes the outcome of a call, and the encoded `SkillCall`; empty where the arguments did not fit."""


class CallListener(Protocol):
    """Is notified of the skill calls that are made through a transport."""

    def begin(self, skill: Skill[..., Any], caller: str) -> CallEnded | None:
        """A call is made. Returns what is called when it has ended; None: this call is not logged."""
        ...


class SkillCaller:
    """The part of a transport that calls skills. It numbers, encodes, logs and decodes; the transport delivers."""

    def __init__(self, identity: str, call_log: CallListener | None = None) -> None:
        """`identity` names the caller to the components that it calls."""
        self.identity = identity
        self.call_log = call_log
        self._call_numbers = itertools.count(1)

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Algorithm 1; a cancelled caller cancels the skill. Never raises but on cancellation."""
        return await self._call(skill, ignored, *args, **kwargs)

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], told: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """Like `call`, with progress."""
        return await self._call(skill, decoding(skill, told), *args, **kwargs)

    async def _call(self, skill: Skill[P, R], report: Report, *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        ended = None if self.call_log is None else self.call_log.begin(skill, self.identity)
        request, outcome = b"", Cancelled()
        try:
            call_id = f"{self.identity}-{next(self._call_numbers)}"
            encoded = encode_call(skill, call_id, self.identity, *args, **kwargs)
            if isinstance(encoded, Rejected):
                outcome = encoded
            else:
                request = encoded
                answer = await self._deliver(skill, request, call_id, report)
                outcome = decode_answer(skill, answer) if isinstance(answer, bytes) else answer
        finally:
            if ended is not None:
                ended(outcome, request)
        return outcome

    async def _deliver(
        self, skill: Skill[..., Any], request: bytes, call_id: str, report: Report
    ) -> bytes | TimedOut | Unreachable:
        """Hand an encoded `SkillCall` to its component, and progress to `report`; the encoded outcome."""
        raise NotImplementedError


def encode_call(skill: Skill[P, R], call_id: str, caller: str, *args: P.args, **kwargs: P.kwargs) -> bytes | Rejected:
    """The message (component, skill, serialized arguments), or why there is none."""
    try:
        arguments = skill.encode_arguments(*args, **kwargs)
    except (CommunicationError, TypeError) as error:
        return Rejected(reason="bad_arguments", detail=f"{skill.key}: {error}")
    call = SkillCall(
        component=skill.component,
        skill=skill.name,
        arguments=arguments,
        call_id=call_id,
        caller=caller,
        schema=skill.schema,
    )
    return codec.encode(call)


def decode_answer(skill: Skill[P, R], answer: bytes) -> Outcome[R]:
    """The outcome, or the failure to understand it."""
    try:
        outcome: Outcome[R] = codec.decode(answer, skill.outcome_type)
    except CommunicationError as error:
        return Failed(reason="malformed_outcome", detail=f"{skill.key}: {error}")
    if isinstance(outcome, Rejected) and outcome.reason == SCHEMA_MISMATCH:
        log.error("%s was not run: %s", skill.key, outcome.detail)
    return outcome


def decoding(skill: ReportingSkill[P, R, Q], told: Callable[[Q], None]) -> Report:
    """Takes encoded progress and tells it. Neither a malformed piece nor a listener's mistake ends the call."""

    def tell(data: bytes) -> None:
        try:
            told(skill.decode_report(data))
        except CommunicationError as error:
            log.warning("progress of %s cannot be understood: %s", skill.key, error)
        except Exception:  # it is the caller's code: its mistake must not reach the transport that delivers
            log.exception("whoever follows %s raised", skill.key)

    return tell


def ignored(data: bytes) -> None:
    """Takes progress that the caller did not ask for."""
