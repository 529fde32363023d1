"""What a skill is: a name, a typed signature, and a contract of what must hold before, during and after it."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any, Generic, ParamSpec, TypeVar, get_type_hints

import msgspec

from dlokit.communication.wire import codec
from dlokit.communication.wire.schema import fingerprint
from dlokit.errors import CommunicationError
from dlokit.types.outcome import Cancelled, Failed, Rejected, Succeeded, TimedOut, Unreachable


@dataclass(frozen=True)
class Condition:
    """One thing that must hold."""

    text: str
    """In words."""
    reason: str = ""
    """Name of the outcome when it does not; empty: in words only, the skill itself sees to it."""
    of: Callable[..., bool] | None = None
    """Whether it holds for the arguments that it takes, by their names. None: only the component knows; it marks the
    method that tells with `dlokit.communication.component.holds`."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the skill's arguments that it looks at."""
        return () if self.of is None else tuple(inspect.signature(self.of).parameters)

    def broken_by(self, arguments: Mapping[str, Any]) -> str | None:
        """What is wrong with the arguments, for people; None when nothing is, or when it is not about them."""
        if self.of is None:
            return None
        seen = {name: arguments[name] for name in self.parameters}
        if self.of(**seen):
            return None
        return f"needed: {self.text}; given: " + ", ".join(f"{name} = {value}" for name, value in seen.items())


def conditions(declared: str | tuple[Condition, ...]) -> tuple[Condition, ...]:
    """A part of a contract as conditions; words alone are one that nobody checks."""
    if isinstance(declared, str):
        return (Condition(declared),) if declared else ()
    return declared


P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")


SCHEMA_MISMATCH = "schema_mismatch"
"""Reason why a call is rejected whose caller knows the skill otherwise."""


@dataclass(frozen=True)
class Skill(Generic[P, R]):
    """Something a component can be asked to do.

    `signature` is a function whose parameters, return annotation and docstring are the contract; its
    body is never run. A wrong argument is a type error in the editor before it is an outcome.
    """

    component: str
    """Who has it: a component, or `component.instance` where there is more than one of a kind."""
    name: str
    signature: Callable[P, R]
    timeout_s: float
    """Longest time it may run, on the clock that the container lives by."""
    requires: str | tuple[Condition, ...] = ""
    """What must hold before (else rejected): in words, or as conditions that the container checks."""
    ensures: str | tuple[Condition, ...] = ""
    """What holds after it succeeded (else failed)."""
    keeps: tuple[Condition, ...] = ()
    """What must hold all the while: the host checks it before and after, the component meanwhile."""
    exclusive: str = ""
    """What of the component it takes for itself, e.g. ``"motion"``: another skill that takes the same is rejected as
    ``busy`` meanwhile."""

    @cached_property
    def key(self) -> str:
        """``component.skill``."""
        return f"{self.component}.{self.name}"

    def at(self, instance: str) -> "Skill[P, R]":
        """The same skill of another of its kind: `MOVE_TO.at("opposite")`; an empty name is the first one."""
        return _addressed(self, instance)

    @cached_property
    def preconditions(self) -> tuple[Condition, ...]:
        """`requires` as conditions."""
        return conditions(self.requires)

    @cached_property
    def postconditions(self) -> tuple[Condition, ...]:
        """`ensures` as conditions."""
        return conditions(self.ensures)

    @property
    def doc(self) -> str:
        """What it does."""
        return inspect.getdoc(self.signature) or ""

    @cached_property
    def types(self) -> dict[str, Any]:
        """Types of its arguments by their names, and of its result as ``return``."""
        return get_type_hints(self.signature)

    @cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self.signature)

    @cached_property
    def arguments_type(self) -> type[msgspec.Struct]:
        """What its arguments are on the wire: a Struct with a field each."""
        fields = [(name, self.types[name]) for name in self._signature.parameters]
        return msgspec.defstruct(f"{self.name}_arguments", fields, forbid_unknown_fields=True, eq=False)

    @cached_property
    def outcome_type(self) -> Any:
        """What its answer is on the wire: every outcome, a success with its result."""
        result = self.types["return"]
        return Succeeded[result] | Failed | Rejected | Cancelled | TimedOut | Unreachable

    @cached_property
    def schema(self) -> bytes:
        """What its arguments and its result look like on the wire: caller and called one compare it."""
        return fingerprint(self.arguments_type, self.outcome_type)

    def plain_arguments(self, plain: Mapping[str, Any]) -> dict[str, Any]:
        """Arguments from plain values, as JSON has them. Raises `CommunicationError` when they do not fit."""
        signature = self._signature
        try:
            signature.bind(**plain)
            return {name: codec.from_plain(value, self.types[name]) for name, value in plain.items()}
        except (TypeError, CommunicationError) as error:
            raise CommunicationError(f"arguments of {self.key} do not fit: {error}; expected {signature}") from error

    def encode_arguments(self, *args: P.args, **kwargs: P.kwargs) -> bytes:
        """Serialized arguments, defaults filled in (Algorithm 1, first line).

        Raises `TypeError` when they do not fit the signature, `CommunicationError` when they cannot be sent.
        """
        fields = self.arguments_type.__struct_fields__
        if len(args) == len(fields) and not kwargs:
            named = dict(zip(fields, args, strict=True))  # as most calls are; to bind takes ten times as long
        else:
            bound = self._signature.bind(*args, **kwargs)
            bound.apply_defaults()
            named = bound.arguments
        return codec.encode(self.arguments_type(**named))

    def decode_arguments(self, data: bytes) -> dict[str, Any]:
        """Arguments by name (Algorithm 2). Raises `CommunicationError` when they do not fit."""
        try:
            return msgspec.structs.asdict(codec.decode(data, self.arguments_type))
        except CommunicationError as error:
            raise CommunicationError(
                f"arguments of {self.key} do not fit: {error}; expected {self._signature}"
            ) from error


@cache  # its types for encoding are made once; there are as many as skills and instances
def _addressed(skill: Skill[..., Any], instance: str) -> Skill[..., Any]:
    kind = skill.component.partition(".")[0]
    return replace(skill, component=f"{kind}.{instance}" if instance else kind)


@dataclass(frozen=True)
class ReportingSkill(Skill[P, R], Generic[P, R, Q]):
    """A skill that tells its caller how far it is."""

    reports: type[Q] = field(kw_only=True)
    """What it tells, again and again until it ends."""

    def at(self, instance: str) -> "ReportingSkill[P, R, Q]":
        """The same skill of another of its kind."""
        addressed = _addressed(self, instance)
        assert isinstance(addressed, ReportingSkill)
        return addressed

    @cached_property
    def schema(self) -> bytes:
        """With what it tells."""
        return fingerprint(self.arguments_type, self.outcome_type, self.reports)

    def decode_report(self, data: bytes) -> Q:
        """A piece of progress of the declared type. Raises `CommunicationError` when it is anything else."""
        return codec.decode(data, self.reports)


class SkillCall(msgspec.Struct, frozen=True, kw_only=True):
    """The message of Algorithm 1: (component, skill, serialized arguments)."""

    component: str
    skill: str
    arguments: bytes
    call_id: str
    caller: str
    schema: bytes = b""
    """Of the skill, as the caller knows it; empty from versions that did not say."""
