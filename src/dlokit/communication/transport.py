"""The transport protocol, which carries messages and calls in memory or over zenoh, and the reader's mailbox."""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

from dlokit.communication.skill import ReportingSkill, Skill, SkillCall
from dlokit.communication.topic import Every, Policy, Topic
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome

T = TypeVar("T")


class Mailbox(AsyncIterator[T], Generic[T]):
    """Queue of received messages for one reader, bounded by the topic's policy; a full one drops the oldest."""

    def __init__(self, policy: Policy, refresh: Callable[[], None] | None = None) -> None:
        """`refresh` fetches messages that arrived while the loop was busy."""
        self._items: deque[tuple[T, float]] = deque(maxlen=policy.depth if isinstance(policy, Every) else 1)
        self._refresh = refresh
        self._waiting: asyncio.Future[None] | None = None
        self._closed = False
        self._read_sent_s = float("-inf")
        self.dropped = 0

    @property
    def age_s(self) -> float:
        """Time since the last read message was sent [s]; inf before the first."""
        return asyncio.get_running_loop().time() - self._read_sent_s

    def put(self, item: T, sent_s: float) -> None:
        """Add a message that was sent at `sent_s` on the loop's clock; call this on the loop's thread."""
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append((item, sent_s))
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)

    def close(self) -> None:
        """Accept no more messages: the reader gets the waiting ones, then the iteration ends."""
        self._closed = True
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)

    def __aiter__(self) -> "Mailbox[T]":
        return self

    async def __anext__(self) -> T:
        if self._refresh is not None:
            self._refresh()
        while not self._items:
            if self._closed:
                raise StopAsyncIteration
            self._waiting = asyncio.get_running_loop().create_future()
            await self._waiting
        item, self._read_sent_s = self._items.popleft()
        return item


M = TypeVar("M", bound=Message)
T_co = TypeVar("T_co", covariant=True)
P = ParamSpec("P")
R = TypeVar("R")
Q = TypeVar("Q")

Report = Callable[[bytes], None]
"""Sends one encoded piece of progress to the caller; returns at once."""

CallHandler = Callable[[SkillCall, Report], Awaitable[bytes]]
"""Takes a call and returns its encoded `Outcome`; raises only on cancellation."""


@dataclass(frozen=True)
class Latest(Generic[M]):
    """The newest message of a topic."""

    value: M | None
    """None before the first message."""
    age_s: float
    """Time since it was sent [s], or since it arrived if another machine sent it; inf before the first message."""


class Stream(Protocol[T_co]):
    """Messages of one topic for one reader: an async iterator that also reports their age."""

    def __aiter__(self) -> AsyncIterator[T_co]: ...

    async def __anext__(self) -> T_co: ...

    @property
    def age_s(self) -> float:
        """Time since the last read message was sent [s]; inf before the first."""
        ...


@dataclass(frozen=True)
class Liveness:
    """Whether a component was reachable when this was asked, and in which process."""

    alive: bool
    """Whether it answers calls."""
    server: str = ""
    """Id of the process that serves it, a new one after a restart; empty if there is only one process."""


class Transport(Protocol):
    """Publish and read messages, call skills; typed by the rows of the topic and the skill."""

    @property
    def identity(self) -> str:
        """Name of this caller, as the called components see it."""
        ...

    def publish(self, topic: Topic[M], message: M) -> None:
        """Send a message to all readers; returns at once."""
        ...

    def latest(self, topic: Topic[M]) -> Latest[M]:
        """The newest message; the first call on a topic subscribes to it."""
        ...

    def stream(self, topic: Topic[M], *, with_last: bool = False) -> Stream[M]:
        """Messages from now on, in order; the topic's policy decides which messages a slow reader loses.

        With `with_last`, the last message published earlier comes first, so that a late reader receives it.
        """
        ...

    async def call(self, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> Outcome[R]:
        """Call a skill and wait for its outcome (Algorithm 1). Raises only on cancellation."""
        ...

    async def call_reported(
        self, skill: ReportingSkill[P, R, Q], on_progress: Callable[[Q], None], *args: P.args, **kwargs: P.kwargs
    ) -> Outcome[R]:
        """Like `call`; `on_progress` gets each report in order, before the outcome, on the loop's thread."""
        ...

    def send(self, skill: Skill[P, Any], *args: P.args, **kwargs: P.kwargs) -> None:
        """Call a skill and return at once, without its outcome. Live, any thread may call this."""
        ...

    def tap(self, topic: Topic[Any], listener: Callable[[bytes], None]) -> None:
        """Pass every message of a topic, still encoded, to `listener`; live, on a network thread."""
        ...

    def alive(self, component: str) -> Liveness:
        """Whether a component can be called."""
        ...

    def serve(self, component: str, handler: CallHandler) -> None:
        """Answer calls to a component with `handler` (Algorithm 2)."""
        ...

    async def withdraw(self, component: str) -> None:
        """Stop answering calls; over a network, running calls are cancelled."""
        ...

    async def close(self) -> None:
        """Stop all communication and end all streams."""
        ...


async def first_message(transport: Transport, topic: Topic[M], within_s: float, *, with_last: bool = True) -> M | None:
    """The last message of a topic, or the next one; without `with_last` the next one. None: none within `within_s` [s].

    `within_s` counts on the event loop's clock.
    """
    with contextlib.suppress(TimeoutError, StopAsyncIteration):
        async with asyncio.timeout(within_s):
            return await anext(transport.stream(topic, with_last=with_last))
    return None
