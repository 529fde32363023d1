"""What carries messages and calls: in memory, or over zenoh."""

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.topic import Topic
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome

T = TypeVar("T", bound=Message)
T_co = TypeVar("T_co", covariant=True)
P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

Report = Callable[[bytes], None]
"""Sends one encoded piece of progress to the caller; returns at once."""

CallHandler = Callable[[bytes, Report], Awaitable[bytes]]
"""Takes an encoded `SkillCall`, gives an encoded `Outcome`; never raises but on cancellation."""


@dataclass(frozen=True)
class Latest(Generic[T]):
    """The newest message of a topic."""

    value: T | None
    """None when nothing has come yet."""
    age_s: float
    """Time since it was sent, on the loop's clock [s]; from another machine, since it arrived. Inf: nothing has."""


class Stream(Protocol[T_co]):
    """Messages of one topic for one reader: an async iterator that knows their age."""

    def __aiter__(self) -> AsyncIterator[T_co]: ...

    async def __anext__(self) -> T_co: ...

    @property
    def age_s(self) -> float:
        """Time since the message that was read last was sent [s]; inf before the first."""
        ...


class Liveness(Protocol):
    """What is known of a component."""

    @property
    def alive(self) -> bool:
        """Whether it answers."""
        ...

    @property
    def server(self) -> str:
        """Which process serves it: another one after a restart. Empty where there is but one process."""
        ...


@dataclass(frozen=True)
class Known:
    """Liveness by knowledge of this moment."""

    alive: bool
    """Whether it answers."""
    server: str = ""
    """Which process serves it: another one after a restart. Empty where there is but one process."""


class Transport(Protocol):
    """Publish, read, call. Typed by the topic's and the skill's row."""

    @property
    def identity(self) -> str:
        """Who calls through it, as the called ones see it."""
        ...

    def publish(self, topic: Topic[T], message: T) -> None:
        """Send a message to all readers; returns at once."""
        ...

    def latest(self, topic: Topic[T]) -> Latest[T]:
        """The newest message; the first call on a topic subscribes to it."""
        ...

    def stream(self, topic: Topic[T], *, with_last: bool = False) -> Stream[T]:
        """Messages that come from now on, in order; drops as the topic's row says.

        With `with_last`, the last one of before comes first, so that whoever joins late knows it.
        """
        ...

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Ask for a skill and wait for what becomes of it (Algorithm 1). Never raises but on cancellation."""
        ...

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], told: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """Like `call`; `told` hears of the skill's progress in order, before the outcome, on the loop's thread."""
        ...

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """Ask for a skill and return at once; what becomes of it is not told. Live, from any thread."""
        ...

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """Hand every message of a topic, still encoded, to `listener`; live, on a thread of the network's."""
        ...

    def alive(self, component: str) -> Liveness:
        """Whether a component is there to be called."""
        ...

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to a component (Algorithm 2 is the handler)."""
        ...

    async def withdraw(self, component: str) -> None:
        """Answer no more; over a network, calls that run are cancelled."""
        ...

    async def close(self) -> None:
        """Stop everything; streams end."""
        ...
