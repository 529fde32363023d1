"""The caller's side of a skill call, the same on every transport (Algorithm 1)."""

from typing import ParamSpec, TypeVar

from dlokit.communication import codec
from dlokit.communication.skill import Skill, SkillCall
from dlokit.errors import CommunicationError
from dlokit.types.outcome import Failed, Outcome, Rejected

P = ParamSpec("P")
R = TypeVar("R")


def encode_call(skill: Skill[P, R], call_id: str, caller: str, *args: P.args, **kwargs: P.kwargs) -> bytes | Rejected:
    """The message (component, skill, serialized arguments), or why there is none."""
    try:
        arguments = skill.encode_arguments(*args, **kwargs)
    except (CommunicationError, TypeError) as error:
        return Rejected(reason="bad_arguments", detail=f"{skill.key}: {error}")
    call = SkillCall(component=skill.component, skill=skill.name, arguments=arguments, call_id=call_id, caller=caller)
    return codec.encode(call)


def decode_answer(skill: Skill[P, R], answer: bytes) -> Outcome[R]:
    """The outcome, or the failure to understand it."""
    try:
        return skill.decode_outcome(answer)
    except CommunicationError as error:
        return Failed(reason="malformed_outcome", detail=f"{skill.key}: {error}")
