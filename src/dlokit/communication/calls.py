"""The caller's side of a skill call, the same on every transport (Algorithm 1)."""

import logging
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from dlokit.communication.skill import SCHEMA_MISMATCH, ReportingSkill, Skill, SkillCall
from dlokit.communication.transport import Report
from dlokit.communication.wire import codec
from dlokit.errors import CommunicationError
from dlokit.types.outcome import Failed, Outcome, Rejected

P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

log = logging.getLogger(__name__)


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
        outcome = skill.decode_outcome(answer)
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


def unheard(data: bytes) -> None:
    """Takes progress that nobody has asked for."""
