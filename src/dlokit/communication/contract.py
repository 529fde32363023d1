"""What must hold before, during and after a skill; declared beside it, checked by the host where it can be checked."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


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
