"""The base class of components: each declares the topics it reads and publishes and the skills it implements."""

import inspect
from collections.abc import Callable, Coroutine
from functools import cached_property
from typing import Any, ClassVar, Concatenate, ParamSpec, TypeVar

from dlokit.communication.port import Port
from dlokit.communication.skill import Condition, ReportingSkill, Skill
from dlokit.communication.topic import Topic
from dlokit.types.message import Message

P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")
T = TypeVar("T", bound=Message)
C = TypeVar("C", bound="Component")
F = TypeVar("F", bound=Callable[..., Any])

_SKILL = "_dlokit_skill"
_TOPIC = "_dlokit_topic"
_CONDITION = "_dlokit_condition"


def _marking(mark: str, value: object) -> Callable[[F], F]:
    """Mark a method with its purpose, and return it unchanged."""

    def marked(method: F) -> F:
        setattr(method, mark, value)
        return method

    return marked


def implements(
    skill: Skill[P, R],
) -> Callable[
    [Callable[Concatenate[C, P], Coroutine[Any, Any, R]]], Callable[Concatenate[C, P], Coroutine[Any, Any, R]]
]:
    """Mark a method as the implementation of a skill; its signature must be the skill's."""
    return _marking(_SKILL, skill)


def implements_reporting(
    skill: ReportingSkill[P, R, Q],
) -> Callable[
    [Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]]],
    Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]],
]:
    """Like `implements`, for a skill that reports: the method's first argument sends progress to the caller."""
    return _marking(_SKILL, skill)


def holds(
    condition: Condition,
) -> Callable[[Callable[Concatenate[C, str, P], str | None]], Callable[Concatenate[C, str, P], str | None]]:
    """Mark a method that checks a condition for a caller: it returns None, or a text that describes the violation.

    Its first parameter is the caller's name; further parameters take the skill's arguments of the same names.
    """
    return _marking(_CONDITION, condition)


def on(
    topic: Topic[T],
) -> Callable[[Callable[[C, T], Coroutine[Any, Any, None]]], Callable[[C, T], Coroutine[Any, Any, None]]]:
    """Mark a method as the handler of a topic: it gets each message, one at a time, in order."""
    return _marking(_TOPIC, topic)


class Component:
    """Base class of all components. The container attaches the port through which a component communicates."""

    name: ClassVar[str]
    publishes: ClassVar[tuple[Topic[Any], ...]] = ()
    reads: ClassVar[tuple[Topic[Any], ...]] = ()
    """Topics read through ``port.latest`` or ``port.stream``, in addition to those with a handler."""

    instance: str = ""
    """Name of the instance where there is more than one, e.g. the second robot; empty: the first."""

    port: Port

    @cached_property
    def address(self) -> str:
        """Its name on the bus."""
        return f"{self.name}.{self.instance}" if self.instance else self.name

    def attach(self, port: Port) -> None:
        """Take the port; the container calls this once, before anything runs."""
        self.port = port

    async def run(self) -> None:
        """Background task, which the container starts and cancels; it may return."""

    def preparation(self) -> Callable[[], object] | None:
        """Function that ``port.compute`` runs before the first call, e.g. to load modules in the compute process.

        None: the component computes nothing there, or nothing that is slow the first time.
        """
        return None

    @classmethod
    def skills(cls) -> dict[Skill[..., Any], str]:
        """Skill → name of the method that implements it."""
        return _marked(cls, _SKILL)

    @classmethod
    def handlers(cls) -> dict[Topic[Any], str]:
        """Topic → name of the method that handles it."""
        return _marked(cls, _TOPIC)

    @classmethod
    def conditions(cls) -> dict[Condition, str]:
        """Condition → name of the method that checks it."""
        return _marked(cls, _CONDITION)

    @classmethod
    def subscribes(cls) -> tuple[Topic[Any], ...]:
        """All topics that it reads."""
        return tuple(dict.fromkeys((*cls.handlers(), *cls.reads)))


def _marked(cls: type[Component], mark: str) -> dict[Any, str]:
    # A dictionary in the order of the class body, so that containers start handlers in a repeatable order.
    found: dict[Any, str] = {}
    for base in reversed(cls.__mro__):
        for name, member in vars(base).items():
            if inspect.isfunction(member) and hasattr(member, mark):
                found[getattr(member, mark)] = name
    return found
