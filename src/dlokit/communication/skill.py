"""Skills: a name, a typed signature, and a contract with preconditions, invariants and postconditions."""

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
    """One condition of a contract."""

    text: str
    """The condition as a sentence."""
    reason: str = ""
    """Reason of the outcome when it does not hold; empty: the container does not check it, the skill does."""
    of: Callable[..., bool] | None = None
    """Whether it holds for the skill's arguments that it names as parameters. None: the component checks it, in a
    method marked with `dlokit.communication.component.holds`."""

    def violation(self, arguments: Mapping[str, Any]) -> str | None:
        """A text that describes the invalid arguments; None if the condition holds or does not concern them."""
        if self.of is None:
            return None
        checked = {name: arguments[name] for name in inspect.signature(self.of).parameters}
        if self.of(**checked):
            return None
        return f"required: {self.text}; given: " + ", ".join(f"{name} = {value}" for name, value in checked.items())


def conditions(declared: str | tuple[Condition, ...]) -> tuple[Condition, ...]:
    """A part of a contract as conditions; a plain text is one condition that the container does not check."""
    if isinstance(declared, str):
        return (Condition(declared),) if declared else ()
    return declared


P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")


SCHEMA_MISMATCH = "schema_mismatch"
"""Reason of a call that is rejected because the caller's schema of the skill differs."""


@dataclass(frozen=True)
class Skill(Generic[P, R]):
    """A named operation that a component offers to callers.

    `signature` is a function whose parameters, return annotation and docstring are the contract; its body never runs.
    A type checker finds a wrong argument before the call is made.
    """

    component: str
    """The component that implements it, or `component.instance` where there is more than one."""
    name: str
    signature: Callable[P, R]
    timeout_s: float
    """Longest time it may run [s], on the container's clock."""
    requires: str | tuple[Condition, ...] = ""
    """Preconditions (else rejected): a text, or conditions that the container checks."""
    ensures: str | tuple[Condition, ...] = ""
    """Postconditions of a success (else failed)."""
    keeps: tuple[Condition, ...] = ()
    """Invariants: the container checks them before and after the skill runs, the component while it runs."""
    exclusive: str = ""
    """Resource of the component that it uses exclusively, e.g. ``"motion"``: while it runs, another skill that uses the
    same resource is rejected as ``busy``."""
    moves_arm: bool = False
    """Whether it moves an arm, or allows a motion."""

    @cached_property
    def key(self) -> str:
        """``component.skill``."""
        return f"{self.component}.{self.name}"

    def at(self, instance: str) -> "Skill[P, R]":
        """The skill of another instance: `MOVE_TO.at("second")`; an empty name is the first instance."""
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
        """Description of the skill: the docstring of its signature."""
        return inspect.getdoc(self.signature) or ""

    @cached_property
    def types(self) -> dict[str, Any]:
        """Types of its arguments by name, and of its result as ``return``."""
        return get_type_hints(self.signature)

    @cached_property
    def call_signature(self) -> inspect.Signature:
        """Parameters and return annotation of `signature`."""
        return inspect.signature(self.signature)

    @cached_property
    def arguments_type(self) -> type[msgspec.Struct]:
        """Struct type of its arguments on the wire, with one field for each argument."""
        fields = [(name, self.types[name]) for name in self.call_signature.parameters]
        return msgspec.defstruct(f"{self.name}_arguments", fields, forbid_unknown_fields=True, eq=False)

    @cached_property
    def outcome_type(self) -> Any:
        """Type of its answer on the wire: the union of all outcomes, where a success has the skill's result."""
        result = self.types["return"]
        return Succeeded[result] | Failed | Rejected | Cancelled | TimedOut | Unreachable

    @cached_property
    def schema(self) -> bytes:
        """Fingerprint of its arguments and outcome on the wire, which the caller and the called component compare."""
        return fingerprint(self.arguments_type, self.outcome_type)

    def plain_arguments(self, plain: Mapping[str, Any]) -> dict[str, Any]:
        """Convert arguments from JSON values. Raises `CommunicationError` when they do not fit the signature."""
        signature = self.call_signature
        try:
            signature.bind(**plain)
            return {name: codec.from_plain(value, self.types[name]) for name, value in plain.items()}
        except (TypeError, CommunicationError) as error:
            raise CommunicationError(f"arguments of {self.key} do not fit: {error}; expected {signature}") from error

    def request(self, call_id: str, caller: str, *args: P.args, **kwargs: P.kwargs) -> "SkillCall":
        """The message of a call, with serialized arguments, defaults filled in (Algorithm 1, first line).

        Raises `CommunicationError` when they do not fit the signature or cannot be sent.
        """
        fields = self.arguments_type.__struct_fields__
        if len(args) == len(fields) and not kwargs:
            named = dict(zip(fields, args, strict=True))  # the common case; `bind` takes ten times as long
        else:
            try:
                bound = self.call_signature.bind(*args, **kwargs)
            except TypeError as error:
                raise CommunicationError(str(error)) from error
            bound.apply_defaults()
            named = bound.arguments
        return SkillCall(
            component=self.component,
            skill=self.name,
            arguments=codec.encode(self.arguments_type(**named)),
            call_id=call_id,
            caller=caller,
            schema=self.schema,
        )


@cache  # so that the types for encoding are made once for each skill and instance
def _addressed(skill: Skill[..., Any], instance: str) -> Skill[..., Any]:
    kind = skill.component.partition(".")[0]
    return replace(skill, component=f"{kind}.{instance}" if instance else kind)


@dataclass(frozen=True)
class ReportingSkill(Skill[P, R], Generic[P, R, Q]):
    """A skill that reports its progress to the caller."""

    reports: type[Q] = field(kw_only=True)
    """Type of the progress reports; it sends any number of them until it ends."""

    def at(self, instance: str) -> "ReportingSkill[P, R, Q]":
        """The skill of another instance."""
        addressed = _addressed(self, instance)
        assert isinstance(addressed, ReportingSkill)
        return addressed

    @cached_property
    def schema(self) -> bytes:
        """Fingerprint that also covers the progress reports."""
        return fingerprint(self.arguments_type, self.outcome_type, self.reports)

    def decode_report(self, data: bytes) -> Q:
        """Decode one progress report. Raises `CommunicationError` when it is not of the declared type."""
        return codec.decode(data, self.reports)


class SkillCall(msgspec.Struct, frozen=True, kw_only=True):
    """The message of Algorithm 1: (component, skill, serialized arguments).

    Over a network only the arguments are encoded: the key names component and skill, the attachment has the rest.
    """

    component: str
    skill: str
    arguments: bytes
    call_id: str
    caller: str
    schema: bytes
    """The caller's fingerprint of the skill."""
