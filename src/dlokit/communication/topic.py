"""Topics: the row of the topic table and the policy for slow readers."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

from dlokit.types.message import Message

T = TypeVar("T", bound=Message)


@dataclass(frozen=True)
class KeepLast:
    """A slow reader receives only the newest message: for states and images."""


@dataclass(frozen=True)
class Every:
    """A reader receives every message in order; more than `depth` waiting messages drop the oldest."""

    depth: int
    """Messages that may wait for one reader."""


Policy = KeepLast | Every


@dataclass(frozen=True)
class Topic(Generic[T]):
    """One row of the topic table."""

    name: str
    """Key on the bus."""
    type: type[T]
    """Type of its messages; decoding refuses any other."""
    publisher: str
    """The one component that may publish it."""
    rate_hz: float | None
    """Expected rate [Hz]; None: irregular, on events."""
    policy: Policy = KeepLast()
    """Policy for the messages that a slow reader loses."""
    doc: str = ""
    """Content, in one line."""
    instance: str = ""
    """Instance of the component that publishes it, e.g. the second robot; empty: the first."""

    @cached_property
    def row(self) -> str:
        """Name of its row in the table, the same for all instances."""
        return self.name.removesuffix(f"/{self.instance}") if self.instance else self.name

    def at(self, instance: str) -> "Topic[T]":
        """The topic of another instance: `ROBOT_STATE.at("second")`; an empty name is the first instance."""
        return replace(self, name=f"{self.row}/{instance}" if instance else self.row, instance=instance)
