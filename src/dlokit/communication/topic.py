"""What a topic is."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, TypeVar

from dlokit.types.message import Message

T = TypeVar("T", bound=Message)


@dataclass(frozen=True)
class KeepLast:
    """A slow reader sees only the newest message: for states and pictures."""


@dataclass(frozen=True)
class Every:
    """A reader sees every message in order, up to `depth` waiting; then the oldest are dropped."""

    depth: int
    """Messages that may wait for one reader."""


Policy = KeepLast | Every


@dataclass(frozen=True)
class Topic(Generic[T]):
    """One row of the topic table."""

    name: str
    """Key on the bus."""
    type: type[T]
    """What it carries; decoding refuses anything else."""
    publisher: str
    """The one component that may publish it."""
    rate_hz: float | None
    """Expected rate [Hz]; None: only when there is something to say."""
    policy: Policy = KeepLast()
    """What a slow reader misses."""
    doc: str = ""
    """One line of what it says."""
    instance: str = ""
    """Whose it is, where there is more than one of its kind; empty: the first one's."""

    @cached_property
    def row(self) -> str:
        """Name of its row in the table, whosever it is."""
        return self.name.removesuffix(f"/{self.instance}") if self.instance else self.name

    def at(self, instance: str) -> "Topic[T]":
        """The same topic of another of its kind: `ROBOT_STATE.at("opposite")`; an empty name is the first one."""
        return replace(self, name=f"{self.row}/{instance}" if instance else self.row, instance=instance)
