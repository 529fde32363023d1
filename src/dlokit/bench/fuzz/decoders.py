"""Every decoder of the bus, with what makes messages for it."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

from dlokit.bench.fuzz.examples import example
from dlokit.communication.skill import ReportingSkill, Skill, SkillCall
from dlokit.communication.topics import TOPICS
from dlokit.communication.wire import codec
from dlokit.communication.wire.envelope import opened, seal
from dlokit.communication.wire.schema import fingerprint
from dlokit.system.table import COMPONENTS
from dlokit.types.outcome import CallRecord


@dataclass(frozen=True)
class Decoder:
    """One way by which bytes from the network become values."""

    name: str
    decode: Callable[[bytes], object]
    """Raises `CommunicationError`, and nothing else, for bytes that it does not understand."""
    sound: Callable[[Random], bytes]
    """A message that it understands."""


def all_decoders() -> list[Decoder]:
    """Of topics, calls, outcomes, progress, and what goes beside a message."""
    types: dict[str, Any] = {topic.name: topic.type for topic in TOPICS}
    types |= {"call": SkillCall, "record of a call": CallRecord}
    found = [_of_type(name, wanted) for name, wanted in types.items()]
    for component in COMPONENTS.values():
        for skill in component.skills():
            found.extend(_of_skill(skill))
    schema = fingerprint(SkillCall)
    found.append(Decoder("envelope", lambda data: opened(data, schema), lambda rng: seal(schema)))
    return found


def _of_type(name: str, wanted: Any) -> Decoder:
    return Decoder(name, lambda data: codec.decode(data, wanted), lambda rng: codec.encode(example(wanted, rng)))


def _of_skill(skill: Skill[..., Any]) -> list[Decoder]:
    arguments = skill.arguments_type
    found = [
        Decoder(
            f"arguments of {skill.key}",
            skill.decode_arguments,
            lambda rng: codec.encode(example(arguments, rng)),
        ),
        _of_type(f"outcome of {skill.key}", skill.outcome_type),
    ]
    if isinstance(skill, ReportingSkill):
        found.append(
            Decoder(
                f"progress of {skill.key}",
                skill.decode_report,
                lambda rng: codec.encode(example(skill.reports, rng)),
            )
        )
    return found
