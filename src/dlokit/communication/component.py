"""What a component is: a plain object that says what it reads, publishes, and can do."""

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

_SKILL = "_dlokit_skill"
_TOPIC = "_dlokit_topic"
_CONDITION = "_dlokit_condition"


def implements(
    skill: Skill[P, R],
) -> Callable[
    [Callable[Concatenate[C, P], Coroutine[Any, Any, R]]], Callable[Concatenate[C, P], Coroutine[Any, Any, R]]
]:
    """Mark a method as the implementation of a skill; its signature must be the skill's."""

    def mark(
        method: Callable[Concatenate[C, P], Coroutine[Any, Any, R]],
    ) -> Callable[Concatenate[C, P], Coroutine[Any, Any, R]]:
        setattr(method, _SKILL, skill)
        return method

    return mark


def implements_reporting(
    skill: ReportingSkill[P, R, Q],
) -> Callable[
    [Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]]],
    Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]],
]:
    """The same for a skill that reports: the method's first argument tells the caller how far it is."""

    def mark(
        method: Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]],
    ) -> Callable[Concatenate[C, Callable[[Q], None], P], Coroutine[Any, Any, R]]:
        setattr(method, _SKILL, skill)
        return method

    return mark


def holds(condition: Condition) -> Callable[[Callable[[C, str], str | None]], Callable[[C, str], str | None]]:
    """Mark a method that knows whether a condition holds for a caller: None, or what is wrong, for people."""

    def mark(method: Callable[[C, str], str | None]) -> Callable[[C, str], str | None]:
        setattr(method, _CONDITION, condition)
        return method

    return mark


def on(
    topic: Topic[T],
) -> Callable[[Callable[[C, T], Coroutine[Any, Any, None]]], Callable[[C, T], Coroutine[Any, Any, None]]]:
    """Mark a method as the handler of a topic: called with each message, one at a time, in order."""

    def mark(
        method: Callable[[C, T], Coroutine[Any, Any, None]],
    ) -> Callable[[C, T], Coroutine[Any, Any, None]]:
        setattr(method, _TOPIC, topic)
        return method

    return mark


class Component:
    """Base of all components. The container attaches a port; everything else is the component's own maths."""

    name: ClassVar[str]
    publishes: ClassVar[tuple[Topic[Any], ...]] = ()
    reads: ClassVar[tuple[Topic[Any], ...]] = ()
    """Topics read through ``port.latest`` or ``port.stream``, beside those with a handler."""

    instance: str = ""
    """Which of its kind it is, where there is more than one; empty: the first."""

    port: Port

    @cached_property
    def address(self) -> str:
        """What it is called on the bus."""
        return f"{self.name}.{self.instance}" if self.instance else self.name

    def attach(self, port: Port) -> None:
        """Called once by the container, before anything runs."""
        self.port = port

    async def run(self) -> None:
        """Background behaviour; started and cancelled by the container. May return."""

    def preparation(self) -> Callable[[], object] | None:
        """What ``port.compute`` does before anyone calls, where it has a process of its own: load what the work needs.

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
        """Condition → name of the method that knows whether it holds."""
        return _marked(cls, _CONDITION)

    @classmethod
    def subscribes(cls) -> tuple[Topic[Any], ...]:
        """Every topic it reads."""
        return tuple(dict.fromkeys((*cls.handlers(), *cls.reads)))


def _marked(cls: type[Component], mark: str) -> dict[Any, str]:
    # A dictionary by class body order, so that hosts start handlers in an order that repeats.
    found: dict[Any, str] = {}
    for base in reversed(cls.__mro__):
        for name, member in vars(base).items():
            if inspect.isfunction(member) and hasattr(member, mark):
                found[getattr(member, mark)] = name
    return found
