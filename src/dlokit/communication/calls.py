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
"""Takes the outcome of a call and its encoded arguments, which are empty if they did not fit the signature."""


class CallListener(Protocol):
    """Gets notified of each skill call that is made through a transport."""

    def begin(self, skill: Skill[..., Any], caller: str) -> CallEnded | None:
        """Note the start of a call. Returns the function to call at its end; None: do not log this call."""
        ...


class SkillCaller:
    """The part of a transport that calls skills: it numbers, encodes, logs and decodes; `_deliver` sends."""

    def __init__(self, identity: str, call_log: CallListener | None = None) -> None:
        """`identity` is the caller's name, as the called components see it."""
        self.identity = identity
        self.call_log = call_log
        self._call_numbers = itertools.count(1)

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Call a skill (Algorithm 1); a cancelled caller cancels the skill. Raises only on cancellation."""
        return await self._call(skill, ignore_progress, *args, **kwargs)

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], on_progress: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """Like `call`; `on_progress` gets the progress reports."""
        return await self._call(skill, decode_progress(skill, on_progress), *args, **kwargs)

    async def _call(self, skill: Skill[P, R], report: Report, *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Algorithm 1: serialize the arguments, send the message, wait for the answer."""
        ended = None if self.call_log is None else self.call_log.begin(skill, self.identity)
        call: SkillCall | None = None
        outcome: Outcome[R] = Cancelled()
        try:
            call = skill.request(f"{self.identity}-{next(self._call_numbers)}", self.identity, *args, **kwargs)
            answer = await self._deliver(skill, call, report)
            outcome = codec.decode(answer, skill.outcome_type) if isinstance(answer, bytes) else answer
        except CommunicationError as error:
            detail = f"{skill.key}: {error}"
            outcome = (
                Rejected(reason="bad_arguments", detail=detail)
                if call is None
                else Failed(reason="malformed_outcome", detail=detail)
            )
        finally:
            if ended is not None:
                ended(outcome, b"" if call is None else call.arguments)
        if isinstance(outcome, Rejected) and outcome.reason == SCHEMA_MISMATCH:
            log.error("%s did not run: %s", skill.key, outcome.detail)
        return outcome

    async def _deliver(self, skill: Skill[..., Any], call: SkillCall, report: Report) -> bytes | TimedOut | Unreachable:
        """Send a call to its component, pass progress to `report`, return the encoded outcome."""
        raise NotImplementedError


def decode_progress(skill: ReportingSkill[P, R, Q], on_progress: Callable[[Q], None]) -> Report:
    """Decode each progress report for `on_progress`. A malformed report or an error of `on_progress` is only logged."""

    def notify(data: bytes) -> None:
        try:
            on_progress(skill.decode_report(data))
        except CommunicationError as error:
            log.warning("progress report of %s dropped: %s", skill.key, error)
        except Exception:  # an error in the caller's code must not reach the transport
            log.exception("the progress callback of %s raised an error", skill.key)

    return notify


def ignore_progress(data: bytes) -> None:
    """Discard progress reports that the caller did not request."""
