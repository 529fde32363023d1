"""What a command of `dlokit` is made of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import tyro

A = TypeVar("A")


@dataclass(frozen=True)
class Command(Generic[A]):
    """One command; each has a module of its own, where it is called COMMAND."""

    arguments: type[A]
    """A dataclass: its fields are the flags, its docstring is the help."""
    run: Callable[[A], int]
    """Does it, and gives the exit code."""
    defaults: Callable[[Sequence[str]], A] | None = None
    """What holds where the command line says nothing, where that depends on the command line (`--config FILE`)."""


def flag(metavar: str, default: str = "") -> Any:
    """A flag that is not set unless it is given; `default` says in words what holds then."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})" if default else "")
