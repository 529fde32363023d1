"""Where messages of one topic wait for one reader."""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable
from typing import Generic, TypeVar

from dlokit.communication.topic import Every, Policy

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
