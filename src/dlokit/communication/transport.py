"""What carries messages and calls, in memory or over zenoh, and where messages wait for their reader."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.topic import Every, Policy, Topic
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome

T = TypeVar("T")


class Mailbox(AsyncIterator[T], Generic[T]):
    """Bounded by the topic's policy; when it is full the oldest message goes. One reader."""

    def __init__(self, policy: Policy, refresh: Callable[[], None] | None = None) -> None:
        """`refresh` fetches what has arrived and was not handed out yet: the loop may have been busy."""
        self._items: deque[tuple[T, float]] = deque(maxlen=policy.depth if isinstance(policy, Every) else 1)
        self._refresh = refresh
        self._woken: asyncio.Future[None] | None = None
        self._closed = False
        self._read_sent_s = float("-inf")
        self.dropped = 0

    @property
    def age_s(self) -> float:
        """Time since the message that was read last was sent [s]; inf before the first."""
        return asyncio.get_running_loop().time() - self._read_sent_s

    def put(self, item: T, sent_s: float) -> None:
        """Add a message that was sent at `sent_s` of the loop's clock; on the loop's thread."""
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append((item, sent_s))
        self._wake()

    def close(self) -> None:
        """No more will come: the reader gets what waits, then the end."""
        self._closed = True
        self._wake()

    def __aiter__(self) -> "Mailbox[T]":
        return self

    async def __anext__(self) -> T:
        if self._refresh is not None:
            self._refresh()
        while not self._items:
            if self._closed:
                raise StopAsyncIteration
            self._woken = asyncio.get_running_loop().create_future()
            await self._woken
        item, self._read_sent_s = self._items.popleft()
        return item

    def _wake(self) -> None:
        if self._woken is not None and not self._woken.done():
            self._woken.set_result(None)


M = TypeVar("M", bound=Message)
T_co = TypeVar("T_co", covariant=True)
P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

Report = Callable[[bytes], None]
"""Sends one encoded piece of progress to the caller; returns at once."""

CallHandler = Callable[[bytes, Report], Awaitable[bytes]]
"""Takes an encoded `SkillCall`, gives an encoded `Outcome`; never raises but on cancellation."""


@dataclass(frozen=True)
class Latest(Generic[M]):
    """The newest message of a topic."""

    value: M | None
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

    def publish(self, topic: Topic[M], message: M) -> None:
        """Send a message to all readers; returns at once."""
        ...

    def latest(self, topic: Topic[M]) -> Latest[M]:
        """The newest message; the first call on a topic subscribes to it."""
        ...

    def stream(self, topic: Topic[M], *, with_last: bool = False) -> Stream[M]:
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
